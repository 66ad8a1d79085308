"""What the reconstructed surface itself says of a grasp: whether the hand gets there, and holds anything.

Not in the paper, whose systems trust the network alone. Quality is learned from few trials for each scene;
where the hand would end up is plain geometry, and the surface is there already.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial import ConvexHull

from neugrasp.geometry.pose import Array
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper

Grid = NDArray[np.float32]

FINGER_SPACING, PALM_SPACING = 0.006, 0.012
"""Metres between the points that stand for the hand's skin: a voxel is 7.5 mm, and a palm is large."""
GRASPED = 0.4
"""Part of the fingers' depth, before the TCP, in which something is to be held."""
CHUNK = 256
"""Poses looked at together."""


@dataclass(frozen=True)
class HandCheck:
    """How much is asked of a grasp."""

    clearance: float = -0.1
    """Least signed distance, in units of the truncation, that the open hand may meet: the surface is not
    known better than to a few millimetres."""
    grip: float = 0.1
    """Least part of the space between the open pads that is inside something."""


class HandProbe:
    """Points of an open hand, to be held into a grid.

    The hand at the end of its approach is all that counts: where the fingers come from, the palm is then.
    """

    def __init__(self, gripper: Gripper):
        mount = np.array([0.0, gripper.max_opening / 2, gripper.finger_mount])
        fingers = [_skin(hull, FINGER_SPACING) + mount for hull in gripper.finger.hulls]
        turned = [points * [-1, -1, 1] for points in fingers]
        palm = [_skin(hull, PALM_SPACING) for hull in gripper.palm.hulls]
        self.hand: Array = np.concatenate([*fingers, *turned, *palm]) - [0, 0, gripper.tcp_height]
        """(n, 3), grasp frame, metres."""
        self.between: Array = _between_pads(gripper)
        """(m, 3), grasp frame, metres."""

    def clearance(self, tsdf: Grid, workspace: Workspace, poses: Array) -> NDArray[np.float32]:
        """Least value (k,) of the grid that the open hand meets at poses (k, 4, 4)."""
        return _read(tsdf, workspace, poses, self.hand, lambda values: values.min(axis=1))

    def grip(self, tsdf: Grid, workspace: Workspace, poses: Array) -> NDArray[np.float32]:
        """Part (k,) of the space between the pads that is inside something, at poses (k, 4, 4)."""
        return _read(tsdf, workspace, poses, self.between, lambda values: (values < 0).mean(axis=1))

    def passes(
        self, check: HandCheck, tsdf: Grid, workspace: Workspace, poses: Array
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether the hand would hold anything at TCP poses (k, 4, 4), and whether it gets there.

        Poses are in the workspace frame. The second is asked only where it matters, and True elsewhere.
        """
        holds = self.grip(tsdf, workspace, poses) >= check.grip
        is_free = np.ones(len(poses), dtype=bool)
        is_free[holds] = self.clearance(tsdf, workspace, poses[holds]) > check.clearance
        return holds, is_free


def _read(
    tsdf: Grid, workspace: Workspace, poses: Array, points: Array, measure: Callable[[Grid], Array]
) -> NDArray[np.float32]:
    """A measure (k,) of the grid at points (n, 3) of poses (k, 4, 4); what lies outside the cube is free."""
    measured = np.empty(len(poses), dtype=np.float32)
    points = points.astype(np.float32)
    for start in range(0, len(poses), CHUNK):
        some = poses[start : start + CHUNK].astype(np.float32)
        placed = points @ some[:, :3, :3].transpose(0, 2, 1) + some[:, None, :3, 3]
        index = placed.reshape(-1, 3).T / np.float32(workspace.voxel_size) - np.float32(0.5)
        values = map_coordinates(tsdf, index, np.float32, order=1, mode="constant", cval=1.0)
        measured[start : start + CHUNK] = measure(values.reshape(len(some), len(points)))
    return measured


def _skin(hull: Array, spacing: float) -> Array:
    """The corners of a convex part and points on its surface."""
    box = hull.max(axis=0) - hull.min(axis=0)
    axes = [np.linspace(-1, 1, max(2, int(np.ceil(edge / spacing)) + 1)) for edge in box]
    cube = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    cube = cube[np.abs(cube).max(axis=1) == 1]
    # From the middle towards every point of the box around it, as far as the part reaches.
    middle = hull.mean(axis=0)
    rays = hull.min(axis=0) + (cube + 1) / 2 * box - middle
    sides = ConvexHull(hull).equations
    speed = rays @ sides[:, :3].T
    reach = -(middle @ sides[:, :3].T + sides[:, 3])
    with np.errstate(divide="ignore"):
        steps = np.where(speed > 1e-12, reach / speed, np.inf).min(axis=1)
    return np.concatenate([hull, middle + np.minimum(steps, 1.0)[:, None] * rays])


def _between_pads(gripper: Gripper) -> Array:
    """A block of points between the open pads, from the tips back over `GRASPED` of the fingers' depth."""
    across = min(float(hull[:, 0].max()) for hull in gripper.finger.hulls)
    tip = gripper.tip_height - gripper.tcp_height
    x = np.linspace(-0.8 * across, 0.8 * across, 3)
    y = np.linspace(-1, 1, 14) * (gripper.max_opening / 2 - 0.002)
    z = np.linspace(-GRASPED * gripper.finger_depth, tip, 5)
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
