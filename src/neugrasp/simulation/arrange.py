"""Random scenes: piles dropped into a tray, objects packed upright, single objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from neugrasp.data.world import Body, Scene
from neugrasp.errors import InputError
from neugrasp.simulation.physics import World

Choices = Sequence[tuple[str, str]]
"""(object_set, name) of the objects to draw from."""

MEAN_EXTRA_OBJECTS = 4
"""A training scene has 1 + Poisson(4) objects."""
MAX_ATTEMPTS = 12
"""Tries to add an object to a packed scene."""
DROP_HEIGHT = 0.2
ABOVE = 1.0
"""Metres: where an object meets nothing."""
CLEARANCE = 0.002
"""Metres between the table and an object that is put down."""


def arrange(kind: str, seed: int, world: World, choices: Choices, num_objects: int | None = None) -> Scene:
    """A settled scene of `kind` "pile", "packed" or "single" without materials; `world` holds it afterwards.

    The same seed, kind and choices give the same scene. `num_objects` is None for training. It may end with
    fewer objects, and even with none, where they left the workspace or found no room.
    """
    if kind not in LAYERS:
        raise InputError(f"unknown kind of scene {kind!r}; choose one of {', '.join(LAYERS)}")
    if not choices:
        raise InputError(f"no objects to choose from for a scene of kind {kind!r}")
    rng = np.random.default_rng([seed, list(LAYERS).index(kind), 7])
    count = 1 + int(rng.poisson(MEAN_EXTRA_OBJECTS)) if num_objects is None else num_objects
    world.clear()
    LAYERS[kind](world, rng, choices, count)
    return Scene(kind, seed, world.bodies())


def _pile(world: World, rng: np.random.Generator, choices: Choices, count: int) -> None:
    size = world.workspace.size
    with world.tray():
        for _ in range(count):
            object_set, name = choices[rng.integers(len(choices))]
            x, y = rng.uniform(size / 3, size * 2 / 3, size=2)
            quaternion = rng.normal(size=4)
            quaternion /= np.linalg.norm(quaternion)
            position = (float(x), float(y), world.workspace.table_height + DROP_HEIGHT)
            world.add(Body(object_set, name, float(rng.uniform(0.8, 1.0)), position, _four(quaternion)))
            world.rest(timeout=1.0)
    world.settle()


def _packed(world: World, rng: np.random.Generator, choices: Choices, count: int) -> None:
    for _ in range(MAX_ATTEMPTS):
        if len(world.bodies()) >= count:
            return
        x, y = rng.uniform(0.08, 0.22, size=2)
        _stand(world, rng, choices[rng.integers(len(choices))], (float(x), float(y)))


def _single(world: World, rng: np.random.Generator, choices: Choices, count: int) -> None:
    x, y, _ = world.workspace.centre
    _stand(world, rng, choices[rng.integers(len(choices))], (float(x), float(y)))


def _stand(
    world: World, rng: np.random.Generator, choice: tuple[str, str], place: tuple[float, float]
) -> None:
    """Puts one object upright where there is room for it; leaves the world as it was where there is none."""
    angle, scale = rng.uniform(0, 2 * np.pi), float(rng.uniform(0.7, 0.9))
    quaternion = Rotation.from_rotvec([0, 0, angle]).as_quat()
    before = world.save()
    body = Body(*choice, scale, (*place, ABOVE), _four(quaternion))
    index = world.add(body)
    # From its lowest point: the origin of a mesh need not be in its middle.
    lowered = world.bottom(index) - world.workspace.table_height - CLEARANCE
    world.place(index, replace(body, position=(*place, ABOVE - lowered)))
    world.step()
    if world.touches(index):
        world.remove(index)
        world.restore(before)
    else:
        world.settle()
    world.forget(before)


def _four(quaternion: np.ndarray) -> tuple[float, float, float, float]:
    x, y, z, w = (float(value) for value in quaternion)
    return x, y, z, w


LAYERS: dict[str, Callable[[World, np.random.Generator, Choices, int], None]] = {
    "pile": _pile,
    "packed": _packed,
    "single": _single,
}
