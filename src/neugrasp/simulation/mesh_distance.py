"""The true distance to the surfaces of a scene, from its meshes: what geometry supervision learns from.

Unlike the fused TSDF (`simulation/gt_tsdf.py`), which the protocol's L1 is judged with, no view is
involved: it is true inside of objects, behind and under them, and Euclidean rather than along rays. The
surfaces are those of the visual meshes: the renderer photographs them, and the engine draws its depth images
from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.world import Body
from neugrasp.geometry.pose import Array
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.objects import ObjectModel
from neugrasp.simulation.placed_meshes import placed_triangles
from neugrasp.simulation.solid import box_distance, signed_distance

Grid = NDArray[np.float32]


class Library(Protocol):
    """Where object models come from."""

    def model(self, object_set: str, name: str) -> ObjectModel: ...


def mesh_distance(bodies: Sequence[Body], library: Library, workspace: Workspace) -> Grid:
    """The signed distance (r, r, r) of settled bodies, such as those of a stored `Scene`, and of the table at
    the voxel centres, indexed [x, y, z]. Raises `InputError` where an object's files are unusable.

    See `union_distance` for what it means.
    """
    solids = [placed_triangles(body, library.model(body.object_set, body.name)) for body in bodies]
    return union_distance(solids, workspace)


def union_distance(solids: Sequence[Array], workspace: Workspace) -> Grid:
    """The signed distance (r, r, r) of the union of solids, triangles (f, 3, 3) each, and of all that lies
    under the table's plane: in units of the truncation, clipped to [-1, 1], + outside, - inside.

    It is the smallest over the solids and the table: exact outside, and inside the depth in the one in which
    the point lies deepest. So it is 0 where a body stands on the table.
    """
    points = workspace.voxel_centres().reshape(-1, 3)
    limit = workspace.truncation
    distance = np.clip(points[:, 2] - workspace.table_height, -limit, limit)
    for triangles in solids:
        at_least = box_distance(points, triangles)
        where = np.flatnonzero((at_least < distance) | (at_least == 0))
        distance[where] = np.minimum(distance[where], signed_distance(points[where], triangles, limit))
    grid: Grid = (distance / limit).astype(np.float32)
    return grid.reshape((workspace.resolution,) * 3)
