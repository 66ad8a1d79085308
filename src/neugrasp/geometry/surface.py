"""The zero level of a truncated signed distance grid as a triangle mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike
from skimage.measure import marching_cubes

from neugrasp.errors import InputError
from neugrasp.geometry.pose import apply
from neugrasp.geometry.workspace import Workspace


@dataclass(frozen=True)
class Surface:
    """A triangle mesh. Seen from outside, the corners of a face run counter-clockwise."""

    vertices: Float[np.ndarray, "vertices 3"]
    """Metres."""
    faces: Int[np.ndarray, "faces 3"]
    """Indices of vertices."""

    def moved(self, new_from_old: ArrayLike) -> Surface:
        """The same surface in another frame."""
        return replace(self, vertices=apply(new_from_old, self.vertices))


def surface_of(tsdf: ArrayLike, workspace: Workspace) -> Surface:
    """The surface in the workspace frame of a grid [x, y, z] in [-1, 1] (positive outside) by marching cubes.

    Empty where the grid changes sign nowhere. The mesh is open at the faces of the cube. Raises `InputError`
    where the grid contains NaN or infinity.
    """
    grid = np.asarray(tsdf, dtype=np.float32)
    if not np.all(np.isfinite(grid)):
        raise InputError("the grid of distances contains NaN or infinity; the weights are damaged")
    if grid.min() >= 0 or grid.max() <= 0:
        return Surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32))
    index, faces, _, _ = marching_cubes(grid, level=0.0, gradient_direction="descent")
    return Surface(workspace.position_of(index), faces.astype(np.int32))
