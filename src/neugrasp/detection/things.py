"""The things that stand on the table, as the reconstructed surface has them: what touches is one thing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from scipy import ndimage

from neugrasp.detection.options import Box
from neugrasp.geometry.pose import apply, inverse
from neugrasp.geometry.workspace import Workspace

ON_TABLE = 0.006
"""Metres above the table from which matter is no table."""
FEWEST = 8
"""Voxels of the smallest thing: a die of 15 mm."""
MARGIN = 0.01
"""Metres by which the region of a thing is larger than the thing: a TCP may lie beside its matter."""


@dataclass(frozen=True, eq=False)
class Thing:
    """One thing."""

    voxels: Float[np.ndarray, "n 3"]
    """Centres of the voxels inside of it, workspace frame, metres."""

    def distance(self, point: ArrayLike) -> float:
        """Metres from a point of the workspace frame to the nearest voxel."""
        return float(np.linalg.norm(self.voxels - np.asarray(point), axis=1).min())

    def region(self, workspace: Workspace) -> Box:
        """The box of the world around it: lower corner, upper corner, metres; for `Steering.region`."""
        corners = apply(workspace.world_from_workspace, self.voxels)
        low, high = corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN
        x0, y0, z0, x1, y1, z1 = np.round([*low, *high], 4).tolist()
        return x0, y0, z0, x1, y1, z1


def matter(tsdf: ArrayLike, workspace: Workspace) -> Bool[np.ndarray, "r r r"]:
    """Which voxels of a grid, negative inside, belong to what stands on the table."""
    height = workspace.voxel_centres()[..., 2]
    return np.asarray((np.asarray(tsdf) < 0) & (height > workspace.table_height + ON_TABLE))


def things_in(tsdf: ArrayLike, workspace: Workspace) -> tuple[Thing, ...]:
    """What stands on the table by a grid [x, y, z], negative inside; the largest thing first."""
    centres = workspace.voxel_centres()
    labels, count = ndimage.label(matter(tsdf, workspace))
    things = [Thing(centres[labels == number]) for number in range(1, count + 1)]
    things = [thing for thing in things if len(thing.voxels) >= FEWEST]
    return tuple(sorted(things, key=lambda thing: -len(thing.voxels)))


def nearest(things: Sequence[Thing], point: ArrayLike, workspace: Workspace) -> int | None:
    """The place in the list of the thing that is nearest to a point of the world; None where none is."""
    if not things:
        return None
    place = apply(inverse(workspace.world_from_workspace), point)
    return int(np.argmin([thing.distance(place) for thing in things]))
