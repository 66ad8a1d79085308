"""Random antipodal grasps on a known surface: what geometry alone is worth, without any learning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates
from skimage.measure import marching_cubes

from neugrasp.geometry.pose import Array, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper

FRICTION_ANGLE = np.deg2rad(20)
"""Largest angle between the closing axis and the surface's normal on either side."""
STEEPEST = np.deg2rad(75)
"""Largest angle between the approach and straight down."""
MAX_TRIES = 2000


@dataclass(frozen=True)
class _Surface:
    """Points (n, 3) of the zero level above the table with outward normals, workspace frame."""

    points: Array
    normals: Array


def antipodal_grasp(
    tsdf: np.ndarray, workspace: Workspace, gripper: Gripper, rng: np.random.Generator
) -> Grasp | None:
    """One grasp (workspace frame) drawn at random among antipodal pairs of points; None if none is found.

    A pair is kept where both normals lie within the friction cone about the line between the points, the
    line is shorter than the gripper opens, and the finger tips stay above the table. Collisions of the hand
    are not looked at.
    """
    surface = _surface_above_table(tsdf, workspace)
    for _ in range(MAX_TRIES if len(surface.points) else 0):
        index = int(rng.integers(len(surface.points)))
        first, inward = surface.points[index], -surface.normals[index]
        pair = _opposite(tsdf, workspace, first, inward, gripper.max_opening - 0.005)
        if pair is None:
            continue
        second, normal = pair
        if np.arccos(np.clip(normal @ inward, -1, 1)) > FRICTION_ANGLE:
            continue
        grasp = _grasp_between(first, second, rng)
        tip = gripper.tip_height - gripper.tcp_height
        if grasp is not None and grasp.advanced(tip).position[2] > workspace.table_height + 0.003:
            return grasp
    return None


def _surface_above_table(tsdf: np.ndarray, workspace: Workspace) -> _Surface:
    if not (tsdf.min() < 0 < tsdf.max()):
        return _Surface(np.zeros((0, 3)), np.zeros((0, 3)))
    vertices, _, normals, _ = marching_cubes(tsdf, 0.0, gradient_direction="ascent")
    points = workspace.position_of(vertices)
    above = points[:, 2] > workspace.table_height + workspace.voxel_size
    return _Surface(
        points[above], -normals[above] if _points_inward(tsdf, vertices, normals) else normals[above]
    )


def _points_inward(tsdf: np.ndarray, vertices: np.ndarray, normals: np.ndarray) -> bool:
    """Whether the distance falls along the normals, most of the time."""
    ahead = map_coordinates(tsdf, (vertices + normals).T, order=1, mode="nearest")
    return bool(np.mean(ahead) < 0)


def _opposite(
    tsdf: np.ndarray, workspace: Workspace, start: Array, direction: Array, reach: float
) -> tuple[Array, Array] | None:
    """Where a line through matter comes out again within `reach`, and the outward normal there."""
    distances = np.arange(0.5 * workspace.voxel_size, reach, 0.25 * workspace.voxel_size)
    index = (start + distances[:, None] * direction) / workspace.voxel_size - 0.5
    values = map_coordinates(tsdf, index.T, order=1, mode="nearest")
    outside = np.flatnonzero(values > 0)
    if len(outside) == 0 or outside[0] == 0:
        return None
    before, after = outside[0] - 1, outside[0]
    share = values[before] / (values[before] - values[after])
    end = start + (distances[before] + share * (distances[after] - distances[before])) * direction
    gradient = _gradient(tsdf, end / workspace.voxel_size - 0.5)
    length = np.linalg.norm(gradient)
    return None if length < 1e-6 else (end, gradient / length)


def _gradient(tsdf: np.ndarray, index: Array) -> Array:
    steps = np.concatenate([np.eye(3), -np.eye(3)]) * 0.5
    values = map_coordinates(tsdf, (index + steps).T, order=1, mode="nearest")
    return np.asarray(values[:3] - values[3:], dtype=np.float64)


def _grasp_between(first: Array, second: Array, rng: np.random.Generator) -> Grasp | None:
    """The TCP midway, closing along the line, with a random approach from above."""
    line = second - first
    width = float(np.linalg.norm(line))
    y = line / width
    down = np.array([0.0, 0.0, -1.0])
    steepest = down - (down @ y) * y
    if np.linalg.norm(steepest) < np.cos(STEEPEST):
        return None
    steepest /= np.linalg.norm(steepest)
    sideways = np.cross(steepest, y)
    angle = rng.uniform(-STEEPEST, STEEPEST)
    z = np.cos(angle) * steepest + np.sin(angle) * sideways
    if -z[2] < np.cos(STEEPEST):
        return None
    return Grasp(rigid(np.stack([np.cross(y, z), y, z], axis=1), (first + second) / 2), width)
