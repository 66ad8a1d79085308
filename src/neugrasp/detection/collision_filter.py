"""What the reconstructed surface itself says of a grasp: how deep the hand can go, whether it gets there at
all, and holds anything.

Not in the paper, whose systems trust the network alone. Quality is learned from few trials for each scene;
where the hand would end up is plain geometry, and the surface is there already.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy.ndimage import map_coordinates
from scipy.spatial import ConvexHull

from neugrasp.geometry.fusion import Grid
from neugrasp.geometry.pose import Array, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper

FINGER_SPACING, PALM_SPACING = 0.006, 0.012
"""Metres between the points that stand for the hand's skin: a voxel is 7.5 mm, and a palm is large."""
GRASPED = 0.4
"""Part of the fingers' depth, before the TCP, in which something is to be held."""
DEEPER, STEP = 0.4, 0.0025
"""Part of the fingers' depth by which a grasp may go deeper than the network said, and metres of a step."""


class CollisionFilter:
    """Points of an open hand, to be held into a grid.

    The hand at the end of its approach is all that counts: where the fingers come from, the palm is then.
    """

    def __init__(
        self, gripper: Gripper, clearance: float = -0.1, pad_fill: float = 0.1, depth_margin: float = 0.0075
    ):
        self.least_clearance = clearance
        """Signed distance, in units of the truncation, below which the open hand may not go: the surface is
        not known better than to a few millimetres."""
        self.least_pad_fill = pad_fill
        """Part of the space between the open pads that must be inside something."""
        self.least_depth_margin = depth_margin
        """Metres by which a hand goes deeper than the network said where it holds more than a rim."""
        self.finger_depth = gripper.finger_depth
        self._setback = gripper.tip_setback
        self.fingers: Float[np.ndarray, "n 3"] = _finger_points(gripper, FINGER_SPACING)
        """Of the open fingers, as far ahead as they come when they close; grasp frame, metres."""
        self.palm: Float[np.ndarray, "p 3"] = _palm_points(gripper, PALM_SPACING)
        """Of a hand that stands for closed fingers; grasp frame, metres."""
        self.between: Float[np.ndarray, "m 3"] = _between_pads(gripper)
        """Grasp frame, metres."""

    def standing(
        self, poses: Float[np.ndarray, "k 4 4"], widths: Float[np.ndarray, " k"]
    ) -> Float[np.ndarray, "k 4 4"]:
        """Where a hand whose closed pads would be at a pose has to stand, so that pads `widths` metres apart
        are there: the same, but for fingers that swing."""
        moved = poses.copy()
        moved[:, :3, 3] += self._setback(widths)[:, None] * poses[:, :3, 2]
        return moved

    def clearance(
        self,
        tsdf: Grid,
        workspace: Workspace,
        poses: Float[np.ndarray, "k 4 4"],
        widths: Float[np.ndarray, " k"],
    ) -> Float32[np.ndarray, " k"]:
        """Least value of the grid that the hand meets at TCP poses, workspace frame, and as it closes
        there to `widths` metres."""
        fingers = _read(tsdf, workspace, poses, self.fingers).min(axis=1)
        palm = _read(tsdf, workspace, self.standing(poses, widths), self.palm).min(axis=1)
        return np.asarray(np.minimum(fingers, palm))

    def pad_fill(
        self, tsdf: Grid, workspace: Workspace, poses: Float[np.ndarray, "k 4 4"]
    ) -> Float[np.ndarray, " k"]:
        """Part of the space between the pads that is inside something, at TCP poses."""
        return np.asarray((_read(tsdf, workspace, poses, self.between) < 0).mean(axis=1))

    def depth_margin(
        self,
        tsdf: Grid,
        workspace: Workspace,
        poses: Float[np.ndarray, "k 4 4"],
        widths: Float[np.ndarray, " k"],
    ) -> Float[np.ndarray, " k"]:
        """How much farther, metres, the open hand can go from TCP poses before it touches.

        Labels come from any depth at which something is held, so the network's depth is the middle of what
        works; what is held deeper slips less (docs/training_log.md). No tolerance here: a hand is moved only
        through what is free.
        """
        depths = STEP * np.arange(round(DEEPER * self.finger_depth / STEP) + 1)
        ahead = np.concatenate([poses @ rigid(translation=(0, 0, depth)) for depth in depths])
        clearance = self.clearance(tsdf, workspace, ahead, np.tile(widths, len(depths)))
        free = clearance.reshape(len(depths), len(poses)) > 0
        return STEP * np.maximum(np.cumprod(free, axis=0).sum(axis=0) - 1, 0)

    def passes(
        self,
        tsdf: Grid,
        workspace: Workspace,
        poses: Float[np.ndarray, "k 4 4"],
        widths: Float[np.ndarray, " k"],
    ) -> tuple[Bool[np.ndarray, " k"], Bool[np.ndarray, " k"]]:
        """Whether the hand would hold anything at TCP poses, and whether it gets there."""
        holds = self.pad_fill(tsdf, workspace, poses) >= self.least_pad_fill
        return holds, self.clearance(tsdf, workspace, poses, widths) > self.least_clearance


def hand_points(gripper: Gripper, spacing: float) -> Float[np.ndarray, "n 3"]:
    """Points on the skin of the open hand in the grasp frame, about `spacing` metres apart."""
    return np.concatenate([_finger_points(gripper, spacing), _palm_points(gripper, spacing)])


def _finger_points(gripper: Gripper, spacing: float) -> Array:
    return _skins(gripper.finger_hulls(gripper.max_opening), spacing) - [0, 0, gripper.tcp_height]


def _palm_points(gripper: Gripper, spacing: float) -> Array:
    return _skins(gripper.palm.hulls, spacing) - [0, 0, gripper.tcp_height]


def _skins(hulls: Sequence[Array], spacing: float) -> Array:
    return np.concatenate([_skin(hull, spacing) for hull in hulls])


def _read(tsdf: Grid, workspace: Workspace, poses: Array, points: Array) -> np.ndarray:
    """The grid (k, n) at points (n, 3) of poses (k, 4, 4); what lies outside the cube is free."""
    placed = points @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
    index = placed.reshape(-1, 3).T / workspace.voxel_size - 0.5
    values: np.ndarray = map_coordinates(tsdf, index, np.float32, order=1, mode="constant", cval=1.0)
    return values.reshape(len(poses), len(points))


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
