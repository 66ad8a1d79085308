"""The surface that a body shows: its visual mesh, where the body lies."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from neugrasp.data.world import Body
from neugrasp.geometry.pose import Array, apply, from_quaternion
from neugrasp.simulation.meshes import Mesh, merged, read_obj
from neugrasp.simulation.objects import ObjectModel


def placed_triangles(body: Body, model: ObjectModel) -> Array:
    """Corners (f, 3, 3) of the visual mesh of a body, workspace frame, metres. `model` is what it is made of.

    Photos and depth images show this mesh; the collision mesh is only what bodies touch one another with.
    """
    mesh = _mesh(model.visual_mesh)
    vertices = apply(from_quaternion(body.quaternion_xyzw, body.position), mesh.vertices * body.scale)
    return vertices[mesh.faces]


@lru_cache(maxsize=256)
def _mesh(path: Path) -> Mesh:
    return merged(read_obj(path))
