"""Grasps worth judging, drawn from a reconstructed surface: antipodal pairs, and approaches near the normal.

All are tried by geometry first with a few points of the hand; what would sink into something is dropped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from neugrasp.detection.collision_filter import hand_points
from neugrasp.geometry.fusion import Grid
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper

CLEARANCE = 0.005
"""Metres above the table below which surface is left alone."""
BORDER = 0.02
"""Metres from the sides of the cube within which surface is left alone, as labels leave it: no camera need
see the corners, and what a network imagines there passes for an object."""
MIN_NORMAL_Z = -0.3
"""Surface that looks further down than this is no place to begin."""
LEAN = np.deg2rad(60)
"""Largest turn of an antipodal grasp about its closing direction, off the steepest approach."""
TILT = np.deg2rad(45)
"""Largest angle between the approach and the inward normal, of the other half."""
STEEPEST = np.cos(np.deg2rad(80))
"""Least part of an approach that leads downwards."""
SPREAD = np.deg2rad(12)
"""Standard deviation of the closing direction about the normal."""
SINK = -0.35
"""Signed distance, in units of the truncation, down to which a point of the hand may lie: surfaces are not
known better, and what judges the candidates sees them, too."""
TIP_ABOVE_TABLE = 0.001
"""Metres."""
FEW = 0.015
"""Metres between the points of the hand that a first look takes."""
FIRST = 8
"""One in so many of them is tried before the others: most of what is drawn sinks into something."""


@dataclass(frozen=True)
class SurfaceCloud:
    """Where a grid changes its sign above the table."""

    points: Float[np.ndarray, "n 3"]
    """Workspace frame, metres."""
    normals: Float[np.ndarray, "n 3"]
    """Unit, outwards."""


def surface_cloud(tsdf: Grid, workspace: Workspace) -> SurfaceCloud:
    """A point on each edge of the grid whose ends have different signs, where objects may be.

    That is above the table, up to the workspace's `photo_height`, and `BORDER` from the sides.
    """
    found = []
    for axis in range(3):
        low = np.moveaxis(tsdf, axis, 0)
        before, after = low[:-1], low[1:]
        index = np.argwhere((before < 0) != (after < 0))
        start, end = before[tuple(index.T)], after[tuple(index.T)]
        places = index.astype(np.float64)
        places[:, 0] += start / (start - end)
        found.append(places[:, np.argsort([axis, *(other for other in range(3) if other != axis)])])
    places = np.concatenate(found)
    points = workspace.position_of(places)
    height = points[:, 2] - workspace.table_height
    across = np.all((points[:, :2] > BORDER) & (points[:, :2] < workspace.size - BORDER), axis=1)
    kept = across & (height > CLEARANCE) & (height < workspace.photo_height)
    points, places = points[kept], places[kept]
    slopes = np.stack([_between(gradient, places) for gradient in np.gradient(tsdf)], axis=-1)
    normals = slopes / np.maximum(np.linalg.norm(slopes, axis=1, keepdims=True), 1e-9)
    upwards = normals[:, 2] > MIN_NORMAL_Z
    return SurfaceCloud(points[upwards], normals[upwards])


class Candidates:
    """Draws grasps of one gripper."""

    def __init__(self, gripper: Gripper):
        self.gripper = gripper
        skin = hand_points(gripper, FEW)
        self.hand: Float[np.ndarray, "n 3"] = skin[
            np.unique(np.round(skin / FEW), axis=0, return_index=True)[1]
        ]
        """Grasp frame, metres: few points, for a first look."""

    def draw(
        self, tsdf: Grid, workspace: Workspace, rng: np.random.Generator, count: int
    ) -> Float[np.ndarray, "k 4 4"]:
        """TCP poses in the workspace frame, k <= `count`, of grasps whose hand comes through.

        Half of what is drawn are antipodal pairs. Fewer, or none, come back where little is free.
        """
        cloud = surface_cloud(tsdf, workspace)
        if not count or not len(cloud.points):
            return np.zeros((0, 4, 4))
        poses = np.concatenate(
            [
                self._antipodal(tsdf, workspace, _some(cloud, rng, 4 * count), rng),
                self._normal(_some(cloud, rng, 4 * count), rng),
            ]
        )
        poses = rng.permutation(poses)
        free = np.zeros((0, 4, 4))
        for begin in range(0, len(poses), 2 * count):
            some = poses[begin : begin + 2 * count]
            free = np.concatenate([free, some[self.comes_through(tsdf, workspace, some)]])
            if len(free) >= count:
                break
        return free[:count]

    def around(
        self, poses: Float[np.ndarray, "k 4 4"], rng: np.random.Generator, each: int
    ) -> Float[np.ndarray, "k*{each} 4 4"]:
        """So many poses around each of the TCP poses: turned, and moved a little.

        By some 6 deg about x and y, 14 deg about the approach, 4 mm, and 7 mm along the approach.
        """
        count = len(poses) * each
        moved = np.repeat(poses, each, axis=0)
        turns = Rotation.from_rotvec(rng.normal(0, [0.1, 0.1, 0.25], (count, 3))).as_matrix()
        steps = rng.normal(0, [0.004, 0.004, 0.007], (count, 3))
        moved[:, :3, 3] += np.einsum("nij,nj->ni", moved[:, :3, :3], steps)
        moved[:, :3, :3] = moved[:, :3, :3] @ turns
        return moved

    def comes_through(
        self, tsdf: Grid, workspace: Workspace, poses: Float[np.ndarray, "k 4 4"]
    ) -> Bool[np.ndarray, " k"]:
        """Whether the few points of the hand stay out of the surface and of the table."""
        around = np.pad(tsdf, 1, constant_values=1.0)
        passed: np.ndarray = poses[:, 2, 2] < -STEEPEST
        for points in (self.hand[::FIRST], self.hand):
            passed[passed] = _free(around, workspace, poses[passed], points)
        return passed

    def _antipodal(
        self, tsdf: Grid, workspace: Workspace, start: SurfaceCloud, rng: np.random.Generator
    ) -> Float[np.ndarray, "k 4 4"]:
        """The TCP midway between two surfaces, closing from one to the other."""
        count = len(start.points)
        closing = _unit(-start.normals + np.tan(SPREAD) * rng.normal(size=(count, 3)) / np.sqrt(2))
        width = _through(tsdf, workspace, start.points, closing, self.gripper.max_opening - 0.003)
        found = np.isfinite(width)
        points, closing, width = start.points[found], closing[found], width[found]
        down = np.array([0.0, 0.0, -1.0])
        steepest = down - closing * closing[:, 2:] * -1
        steep = np.linalg.norm(steepest, axis=1) > 0.3
        points, closing, width = points[steep], closing[steep], width[steep]
        steepest = _unit(steepest[steep])
        angle = rng.uniform(-LEAN, LEAN, (len(points), 1))
        approach = np.cos(angle) * steepest + np.sin(angle) * np.cross(steepest, closing)
        depth = rng.uniform(-0.02, 0.02, (len(points), 1))
        return _poses(points + closing * width[:, None] / 2 + depth * approach, closing, approach)

    def _normal(self, start: SurfaceCloud, rng: np.random.Generator) -> Float[np.ndarray, "k 4 4"]:
        """The approach along the inward normal or tilted off it, any yaw, any depth the fingers reach."""
        count = len(start.points)
        across = _unit(np.cross(start.normals, rng.normal(size=(count, 3))))
        tilt = TILT * rng.random((count, 1)) * (rng.random((count, 1)) < 0.6)
        approach = -np.cos(tilt) * start.normals + np.sin(tilt) * across
        closing = _unit(np.cross(approach, rng.normal(size=(count, 3))))
        depth = rng.uniform(-0.005, 0.9 * self.gripper.tcp_depth, (count, 1))
        return _poses(start.points + depth * approach, closing, approach)


def _free(
    around: Float[np.ndarray, "edge edge edge"],
    workspace: Workspace,
    poses: Float[np.ndarray, "k 4 4"],
    points: Float[np.ndarray, "n 3"],
) -> Bool[np.ndarray, " k"]:
    """Whether points of the grasp frame stay out of a grid, which has a free voxel more on each side."""
    placed = np.matmul(points.astype(np.float32), poses[:, :3, :3].transpose(0, 2, 1), dtype=np.float32)
    placed += poses[:, None, :3, 3].astype(np.float32)
    above: np.ndarray = placed[..., 2].min(axis=1) > workspace.table_height + TIP_ABOVE_TABLE
    edge = len(around)
    index = np.floor(placed * np.float32(1 / workspace.voxel_size)).astype(np.int32) + 1
    x, y, z = np.moveaxis(np.clip(index, 0, edge - 1), -1, 0)
    return above & (around.reshape(-1)[(x * edge + y) * edge + z].min(axis=1) > SINK)


def _some(cloud: SurfaceCloud, rng: np.random.Generator, count: int) -> SurfaceCloud:
    chosen = rng.integers(len(cloud.points), size=count)
    return SurfaceCloud(cloud.points[chosen], cloud.normals[chosen])


def _through(
    tsdf: Grid,
    workspace: Workspace,
    start: Float[np.ndarray, "n 3"],
    along: Float[np.ndarray, "n 3"],
    reach: float,
) -> Float[np.ndarray, " n"]:
    """Metres from points on a surface through matter to where it ends; infinite beyond `reach`."""
    step = workspace.voxel_size / 3
    distances = np.arange(1, int(reach / step) + 1) * step
    places = (start[:, None] + distances[:, None] * along[:, None]) / workspace.voxel_size - 0.5
    values = _between(tsdf, places.reshape(-1, 3)).reshape(len(start), -1)
    outside = values > 0
    outside[:, :2] = False
    first = outside.argmax(axis=1)
    width: np.ndarray = np.where(outside.any(axis=1), distances[first] - step / 2, np.inf)
    return width


def _between(grid: Grid, places: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Trilinear values at fractional indices."""
    values: np.ndarray = map_coordinates(grid, places.T, order=1, mode="nearest")
    return values


def _unit(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    unit: np.ndarray = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
    return unit


def _poses(
    positions: Float[np.ndarray, "k 3"], closing: Float[np.ndarray, "k 3"], approach: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, "k 4 4"]:
    poses = np.zeros((len(positions), 4, 4))
    poses[:, :3, 0] = np.cross(closing, approach)
    poses[:, :3, 1], poses[:, :3, 2], poses[:, :3, 3] = closing, approach, positions
    poses[:, 3, 3] = 1
    return poses
