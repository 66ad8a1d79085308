"""A world of toys: boxes and balls whose size is in their name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh

from neugrasp.data.world import Body, Scene
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.objects import ObjectModel
from neugrasp.simulation.physics import World


class Toys:
    """Makes "box X Y Z" and "ball R", metres; a fifth and a sixth word move a box in its mesh frame, along x
    and z."""

    def __init__(self, folder: Path):
        self.folder = folder

    def model(self, object_set: str, name: str) -> ObjectModel:
        kind, *sizes = name.split()
        numbers = [float(size) for size in sizes]
        if kind == "ball":
            mesh, offset = trimesh.creation.icosphere(4, numbers[0]), (0.0, 0.0, 0.0)
        else:
            x, z = [*numbers[3:], 0.0, 0.0][:2]
            mesh, offset = trimesh.creation.box(numbers[:3]), (x, 0.0, z)
        mesh.vertices += offset
        path = self.folder / f"{name.replace(' ', '_')}.obj"
        mesh.export(path, include_normals=False)
        return ObjectModel(name, path, (path,), mass=0.1, centre_of_mass=offset)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    """A table with a Panda and toys to put on it."""
    with World(Workspace(), Toys(tmp_path_factory.mktemp("toys"))) as world:
        yield world


@pytest.fixture
def toy() -> Callable[..., Body]:
    """A function that puts a toy somewhere, upright where no quaternion is given."""

    def body(
        name: str,
        position: tuple[float, float, float],
        quaternion_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0),
        scale: float = 1.0,
    ) -> Body:
        return Body("toys", name, scale, position, quaternion_xyzw)

    return body


@pytest.fixture
def lay(world: World) -> Callable[..., Scene]:
    """A function that puts bodies, and nothing else, into the world."""

    def scene(*bodies: Body) -> Scene:
        made = Scene("packed", 0, bodies)
        world.reset(made)
        return made

    return scene


@pytest.fixture
def tilted() -> tuple[float, float, float, float]:
    """A rotation about no axis in particular."""
    x, y, z, w = (np.array([0.3, -0.2, 0.4, 0.8]) / np.linalg.norm([0.3, -0.2, 0.4, 0.8])).tolist()
    return x, y, z, w
