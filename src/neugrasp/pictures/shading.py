"""What the surface of a signed distance grid looks like from a camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import map_coordinates

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import Image

PAPER = np.array([245, 245, 245])
OBJECT = np.array([120, 165, 215])
TABLE = np.array([205, 195, 180])
TABLE_TOLERANCE = 0.005
"""Metres above the table plane up to which a surface is tinted as table."""
LIGHT = np.array([-0.35, -0.45, 0.82])
"""Towards the light, workspace frame."""
BISECTIONS = 6


@dataclass(frozen=True)
class _Field:
    """A grid read between its voxel centres; what lies beyond takes the value at the border."""

    grid: np.ndarray
    workspace: Workspace

    def at(self, points: Array) -> Array:
        index = (points / self.workspace.voxel_size - 0.5).T
        values: Array = map_coordinates(self.grid, index, order=1, mode="nearest")
        return values

    def normal(self, points: Array) -> Array:
        """Unit gradients (n, 3), over a voxel to either side: smooth enough to look at."""
        step = self.workspace.voxel_size
        columns = [self.at(points + step * axis) - self.at(points - step * axis) for axis in np.eye(3)]
        gradient = np.stack(columns, axis=-1)
        return gradient / np.maximum(np.linalg.norm(gradient, axis=-1, keepdims=True), 1e-9)


def free_where_unseen(tsdf: ArrayLike) -> np.ndarray:
    """A fused grid whose unseen voxels (exactly -1) read as free space.

    Free space that no depth image came near is marked as unseen, too, and would look like a wall. The inside
    of objects loses its mark as well, which no picture shows.
    """
    grid = np.asarray(tsdf, dtype=np.float32)
    return np.where(grid <= -1, np.float32(1), grid)


def shade_surface(tsdf: ArrayLike, workspace: Workspace, camera: Camera, size: int = 512) -> Image:
    """The surface of a grid [x, y, z] in [-1, 1] as `camera` (world frame) sees it, table tinted differently.

    The picture has the camera's proportions, its longer side `size` pixels.
    """
    scale = size / max(camera.width, camera.height)
    width, height = round(camera.width * scale), round(camera.height * scale)
    whole = (-0.5, -0.5, camera.width - 0.5, camera.height - 0.5)
    camera = camera.cropped_and_resized(whole, width, height).moved(inverse(workspace.world_from_workspace))
    field = _Field(np.asarray(tsdf, dtype=np.float32), workspace)
    far_points = camera.unproject(camera.pixel_grid().reshape(-1, 2), np.ones(width * height))
    rays = far_points - camera.centre
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    hit, points = _trace(field, camera.centre, rays)
    colours = np.broadcast_to(PAPER, (width * height, 3)).astype(np.float64)
    if hit.any():
        colours[hit] = _shade(field, points[hit], rays[hit])
    return colours.reshape(height, width, 3).round().clip(0, 255).astype(np.uint8)


def _enter_and_leave(workspace: Workspace, eye: Array, rays: Array) -> tuple[Array, Array]:
    """Distances along the rays at which they enter and leave the cube; enter >= leave for a miss."""
    safe = np.where(np.abs(rays) < 1e-12, 1e-12, rays)
    low, high = -eye / safe, (workspace.size - eye) / safe
    enter = np.minimum(low, high).max(axis=-1)
    return np.maximum(enter, 0), np.maximum(low, high).min(axis=-1)


def _trace(field: _Field, eye: Array, rays: Array) -> tuple[np.ndarray, Array]:
    """Which rays (n, 3) come upon the surface from outside, and where (n, 3)."""
    workspace = field.workspace
    start, end = _enter_and_leave(workspace, eye, rays)
    shortest = 0.25 * workspace.voxel_size
    distance, last = start.copy(), start.copy()
    value = np.full(len(rays), -1.0)
    hit = np.zeros(len(rays), dtype=bool)
    active = np.flatnonzero(start < end)
    while len(active):
        before, new = value[active], field.at(eye + distance[active, None] * rays[active])
        value[active] = new
        crossed = (before > 0) & (new <= 0)
        hit[active[crossed]] = True
        active = active[~crossed]
        last[active] = distance[active]
        # Half of the distance to the surface, as a predicted field is not an exact distance.
        distance[active] += np.maximum(shortest, 0.5 * np.abs(value[active]) * workspace.truncation)
        active = active[distance[active] < end[active]]
    near, far = last[hit], distance[hit]
    for _ in range(BISECTIONS):
        middle = (near + far) / 2
        outside = field.at(eye + middle[:, None] * rays[hit]) > 0
        near, far = np.where(outside, middle, near), np.where(outside, far, middle)
    distance[hit] = (near + far) / 2
    return hit, eye + distance[:, None] * rays


def _shade(field: _Field, points: Array, rays: Array) -> Array:
    """Colours (n, 3) of surface points: light from above and from the camera, darker in narrow places."""
    workspace = field.workspace
    normals = field.normal(points)
    light = LIGHT / np.linalg.norm(LIGHT)
    brightness = 0.30 + 0.5 * np.clip(normals @ light, 0, 1) + 0.25 * np.abs((normals * rays).sum(axis=-1))
    steps = workspace.truncation * np.array([0.25, 0.5, 0.75])
    open_space = sum(field.at(points + step * normals) * workspace.truncation / step for step in steps)
    brightness = brightness * (0.55 + 0.45 * np.clip(open_space / len(steps), 0, 1))
    is_table = points[:, 2] < workspace.table_height + TABLE_TOLERANCE
    return np.where(is_table[:, None], TABLE, OBJECT) * brightness[:, None]
