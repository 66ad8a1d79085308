"""The labels of a scene: grasps tried at points of its visible surface (VGN)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neugrasp.data.labels import GraspLabels
from neugrasp.geometry.pose import Array, rigid, rotation_about, to_quaternion
from neugrasp.gripper import Gripper
from neugrasp.simulation.batched_trials import execute_each
from neugrasp.simulation.grasp_execution import Trial
from neugrasp.simulation.physics import World
from neugrasp.simulation.surface import SurfacePoints, visible_surface

BORDER = 0.02
"""Metres from the sides and the top of the workspace within which nothing is tried."""
TABLE_CLEARANCE = 0.005
"""Surface lower than this above the table, in metres, is left out."""
MIN_NORMAL_Z = -0.1
"""Surface that looks further down than this is left out."""
DEPTH_SLACK = 0.1
"""Share of the finger's depth by which a grasp point may lie behind the surface or beyond the tips' reach."""


@dataclass(frozen=True)
class Labelling:
    """The labels of a scene, and everything that was tried for them."""

    labels: GraspLabels
    """n grasp points, and whether any yaw succeeds there. The orientation is the middle of the widest run of
    successful yaws, with its width; where none succeeds, that of the first yaw, with the largest opening."""
    poses: Array
    """(n num_yaws, 4, 4) all that was tried, workspace frame, at the TCP: yaw by yaw, point by point."""
    trials: tuple[Trial, ...]
    """What came of each."""


def label(
    world: World,
    rng: np.random.Generator,
    num_points: int = 120,
    num_yaws: int = 6,
    rule: str = "paper",
) -> Labelling:
    """Tries `num_yaws` grasps at each of `num_points` points; the world is afterwards as it was before.

    The yaws are k pi / num_yaws: all distinct, since a turn by pi gives the same grasp (the reference's
    six from 0 to pi inclusive are five). Fewer points come back, or none, where too little can be seen.
    """
    points, rotations = candidates(world, rng, num_points)
    poses = grasp_poses(points, rotations, num_yaws)
    executed = at_tcp(poses, world.gripper).reshape(-1, 4, 4)
    outcomes = execute_each(world, executed, rule)
    trials = iter(outcomes)
    quaternions, widths, successes = [], [], []
    for at_point in poses:
        tried = [next(trials) for _ in at_point]
        best = middle_of_widest_run([trial.success for trial in tried])
        chosen = 0 if best is None else best
        quaternions.append(to_quaternion(at_point[chosen]))
        widths.append(tried[chosen].width)
        successes.append(best is not None)
    labels = GraspLabels(
        np.array(points, dtype=np.float32).reshape(-1, 3),
        np.array(quaternions, dtype=np.float32).reshape(-1, 4),
        np.array(widths, dtype=np.float32),
        np.array(successes, dtype=np.bool_),
    )
    return Labelling(labels, executed, tuple(outcomes))


def grasp_poses(points: Array, rotations: Array, num_yaws: int) -> Array:
    """Poses (n, num_yaws, 4, 4) with the origin at the grasp points, one for each yaw."""
    yaws = [rotation_about((0, 0, 1), np.pi * k / num_yaws) for k in range(num_yaws)]
    poses = [[rigid(r @ yaw, point) for yaw in yaws] for point, r in zip(points, rotations, strict=True)]
    return np.array(poses).reshape(-1, num_yaws, 4, 4)


def at_tcp(poses: Array, gripper: Gripper) -> Array:
    """Poses (..., 4, 4) at grasp points, moved to the TCP."""
    moved = poses.copy()
    moved[..., :3, 3] += gripper.tcp_depth * moved[..., :3, 2]
    return moved


def middle_of_widest_run(successes: list[bool]) -> int | None:
    """Index of the middle of the longest run of True on the circle of yaws; None where there is none."""
    count = len(successes)
    if all(successes):
        return (count - 1) // 2
    best, best_length = None, 0
    for start in range(count):
        if successes[start] and not successes[start - 1]:
            length = next(k for k in range(count) if not successes[(start + k) % count])
            if length > best_length:
                best, best_length = (start + (length - 1) // 2) % count, length
    return best


def candidates(world: World, rng: np.random.Generator, num_points: int) -> tuple[Array, Array]:
    """Grasp points (n, 3) and rotations (n, 3, 3) that look along the inward normal."""
    surface = _graspable(world, visible_surface(world, rng, 50 * num_points))
    depth = world.gripper.finger_depth
    offsets = rng.uniform(-DEPTH_SLACK * depth, (1 + DEPTH_SLACK) * depth, size=len(surface.points))
    points = surface.points + offsets[:, None] * surface.normals
    inside = np.all((points >= BORDER) & (points <= world.workspace.size - BORDER), axis=1)
    points, normals = points[inside][:num_points], surface.normals[inside][:num_points]
    return points, np.array([facing(-normal) for normal in normals]).reshape(-1, 3, 3)


def _graspable(world: World, surface: SurfacePoints) -> SurfacePoints:
    """The part of a surface on which grasps are tried."""
    points, normals = surface.points, surface.normals
    high = points[:, 2] >= world.workspace.table_height + TABLE_CLEARANCE
    inside = np.all((points[:, :2] >= BORDER) & (points[:, :2] <= world.workspace.size - BORDER), axis=1)
    chosen = high & inside & (normals[:, 2] > MIN_NORMAL_Z)
    return SurfacePoints(points[chosen], normals[chosen])


def facing(approach: Array) -> Array:
    """A rotation whose z axis is `approach` and whose x axis lies as close as can be to the world's x."""
    x = np.array([1.0, 0.0, 0.0]) if abs(approach[0]) < 1 - 1e-4 else np.array([0.0, 1.0, 0.0])
    y = np.cross(approach, x)
    y /= np.linalg.norm(y)
    return np.stack([np.cross(y, approach), y, approach], axis=1)
