"""Depth images fused into a truncated signed distance grid, as VGN and Open3D do it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32
from numpy.typing import NDArray

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import apply, inverse
from neugrasp.geometry.workspace import Workspace

Grid = Float32[np.ndarray, "r r r"]
"""Values at the voxels [x, y, z] of a workspace of resolution r."""

MAX_DEPTH = 2.0
"""Depths beyond this many metres are not measurements."""
_FAR = 0.98
"""Open3D drops voxels whose value does not lie in [-0.98, 0.98)."""


@dataclass(frozen=True)
class Tsdf:
    """A truncated signed distance grid; voxel i has its centre at i + 0.5 voxel sizes."""

    values: Grid
    """In [-1, 1], in units of the truncation: 0 surface, + outside, exactly -1 where nothing was seen."""
    weight: Grid
    """How many views saw the voxel, from in front of a surface or from just behind it."""

    @property
    def observed(self) -> Bool[np.ndarray, "r r r"]:
        """Voxels seen by at least one view."""
        return self.weight > 0


def fuse(
    depths: Sequence[Float[np.ndarray, "height width"]], cameras: Sequence[Camera], workspace: Workspace
) -> Tsdf:
    """The running average over z-depth images in metres; cameras are in the workspace frame.

    Each view gives the distance along its ray from the voxel to the surface at the nearest pixel. Depths
    <= 0, beyond 2 m or not finite are no measurements.
    """
    shape = (workspace.resolution,) * 3
    points = workspace.voxel_centres().reshape(-1, 3)
    total, weight = np.zeros(len(points)), np.zeros(len(points))
    for depth, camera in zip(depths, cameras, strict=True):
        where, distance = _distances(depth, camera, points)
        near = distance > -workspace.truncation
        total[where[near]] += np.minimum(distance[near] / workspace.truncation, 1.0)
        weight[where[near]] += 1
    values = np.where(weight > 0, total / np.maximum(weight, 1), -1.0)
    return Tsdf(values.reshape(shape).astype(np.float32), weight.reshape(shape).astype(np.float32))


def vgn_grid(tsdf: Tsdf) -> Grid:
    """VGN's input in [0, 1]: 0.5 surface, towards 1 in front, 0 where unseen or far from every surface."""
    near = tsdf.observed & (tsdf.values >= -_FAR) & (tsdf.values < _FAR)
    grid: Grid = np.where(near, (tsdf.values + 1) / 2, 0).astype(np.float32)
    return grid


def _distances(
    depth: NDArray[np.floating], camera: Camera, points: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Indices of the points that the view measures, and their signed ray distances to the surface."""
    in_camera = apply(inverse(camera.world_from_camera), points)
    z = in_camera[:, 2]
    rays = in_camera / np.where(np.abs(z) < 1e-9, 1e-9, z)[:, None]
    column, row = np.floor(rays @ camera.intrinsics.T[:, :2] + 0.5).T
    height, width = depth.shape
    inside = np.flatnonzero((z > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height))
    measured = depth[row[inside].astype(np.int64), column[inside].astype(np.int64)].astype(np.float64)
    valid = np.isfinite(measured) & (measured > 0) & (measured <= MAX_DEPTH)
    inside, measured = inside[valid], measured[valid]
    return inside, (measured - z[inside]) * np.linalg.norm(rays[inside], axis=1)
