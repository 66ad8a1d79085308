"""Photographed scenes whose objects were measured: poses and meshes beside the photos."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from PIL import Image as Picture

from neugrasp.data.scene_folder import read_scene
from neugrasp.data.strict_json import read_json
from neugrasp.data.world import Body
from neugrasp.errors import InputError, require
from neugrasp.geometry.pose import Array, apply, inverse, to_quaternion
from neugrasp.observation import DepthView, DepthViews, Views
from neugrasp.simulation.meshes import Mesh, merged, read_obj, write_obj
from neugrasp.simulation.objects import ObjectModel, triple
from neugrasp.simulation.silence import quiet

MASS = 0.1
"""Kilograms; the objects were not weighed."""
ROUND = 0.1
"""An object whose two smaller extents differ by less than this share stands about an axis."""


class Meshes:
    """The measured meshes as objects of the simulation; every concave one becomes several convex parts."""

    def __init__(self, source: Path, folder: Path):
        self._source, self._folder = source, folder
        self._models: dict[str, ObjectModel] = {}

    def mesh(self, name: str) -> Mesh:
        """Faces turned outwards. Raises `InputError` where there is no such mesh."""
        mesh = merged(read_obj(self._source / f"{name}.obj"))
        volume, _ = mesh.volume_and_centroid()
        return Mesh(mesh.vertices, mesh.faces if volume > 0 else mesh.faces[:, ::-1])

    def model(self, object_set: str, name: str) -> ObjectModel:
        """Its mass and friction are assumed."""
        if name not in self._models:
            mesh = self.mesh(name)
            visual, convex = self._folder / f"{name}.obj", self._folder / f"{name}_convex.obj"
            write_obj(visual, (mesh,))
            with quiet():
                pybullet = require("pybullet", extra="sim")
                pybullet.vhacd(str(visual), str(convex), str(self._folder / "vhacd.log"))
            self._models[name] = ObjectModel(
                name, visual, (convex,), MASS, centre_of_mass=triple(mesh.middle)
            )
        return self._models[name]


@dataclass(frozen=True)
class Thing:
    """One measured object."""

    name: str
    workspace_from_object: Array
    mesh: Mesh

    @property
    def body(self) -> Body:
        """As the simulation knows it."""
        x, y, z = self.workspace_from_object[:3, 3].tolist()
        qx, qy, qz, qw = to_quaternion(self.workspace_from_object).tolist()
        return Body("real", self.name, 1.0, (x, y, z), (qx, qy, qz, qw))

    @cached_property
    def vertices(self) -> Array:
        """(n, 3), workspace frame, metres."""
        return apply(self.workspace_from_object, self.mesh.vertices)

    @cached_property
    def axis(self) -> tuple[Array, Array] | None:
        """A point and a unit vector, workspace frame, of something round; None of anything else."""
        order = np.argsort(self.mesh.extents)
        small, middle, _ = self.mesh.extents[order]
        if middle / small - 1 > ROUND:
            return None
        return apply(self.workspace_from_object, self.mesh.middle), self.workspace_from_object[:3, order[2]]

    def from_axis(self, points: Array) -> Array:
        """Vectors (n, 3) to points (n, 3) from the axis, at right angles to it, metres."""
        assert self.axis is not None
        offset = points - self.axis[0]
        return np.asarray(offset - (offset @ self.axis[1])[:, None] * self.axis[1])


@dataclass(frozen=True)
class RealScene:
    """A photographed scene and what was measured in it."""

    name: str
    views: Views
    things: tuple[Thing, ...]
    depths: tuple[Path, ...]

    @classmethod
    def read(cls, folder: Path, meshes: Meshes) -> RealScene:
        """Raises `InputError` where scene, truth or meshes are missing."""
        views = read_scene(folder)
        workspace_from_world = inverse(views.workspace.world_from_workspace)
        try:
            entries = read_json(folder / "ground_truth.json", "the ground truth")["objects"]
            things = tuple(
                Thing(e["id"], workspace_from_world @ np.array(e["world_from_object"]), meshes.mesh(e["id"]))
                for e in entries
            )
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{folder}/ground_truth.json: needs 'objects' with poses ({error!r})") from error
        depths = tuple(folder / "depth" / f"{i}.png" for i in range(len(views)))
        return cls(folder.name, views, things, depths if all(map(Path.is_file, depths)) else ())

    def depth_views(self) -> DepthViews:
        """What the depth camera measured."""
        images = [np.asarray(Picture.open(path), dtype=np.float32) / 1000 for path in self.depths]
        pairs = zip(images, self.views.frames, strict=True)
        return DepthViews(tuple(DepthView(v.camera, depth=d) for d, v in pairs), self.views.workspace)
