"""How far two detections of one scene agree: speed is worth nothing where the answer is another one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper


@dataclass(frozen=True)
class Found:
    """What a detection found: the grid [x, y, z] and the grasps in the world, best first."""

    tsdf: NDArray[np.float32]
    grasps: tuple[Grasp, ...]


@dataclass(frozen=True)
class Agreement:
    """One detection against another."""

    tsdf_difference: float
    """The largest, in truncation units, both grids in [-1, 1]."""
    grasps: int
    """How many the first found."""
    reference_grasps: int
    leading: int
    """Of how many places, from the best on, the grasp points are the same voxels."""
    shared: int
    """How many of the reference's grasp points the first found, in whatever order."""


def agreement(product: Found, reference: Found, workspace: Workspace, gripper: Gripper) -> Agreement:
    """Compares voxels of grasp points, of which a detection has at most one in each neighbourhood."""
    ours, theirs = (_grasp_points(found.grasps, gripper) for found in (product, reference))
    near = np.linalg.norm(ours[:, None] - theirs[None], axis=-1) < workspace.voxel_size / 2
    in_place = np.diagonal(near)
    return Agreement(
        float(np.abs(product.tsdf - reference.tsdf).max()),
        len(ours),
        len(theirs),
        len(in_place) if in_place.all() else int(np.argmin(in_place)),
        int(near.any(axis=0).sum()),
    )


def _grasp_points(grasps: Sequence[Grasp], gripper: Gripper) -> NDArray[np.float64]:
    points = [grasp.advanced(-gripper.tcp_depth).position for grasp in grasps]
    return np.array(points, dtype=np.float64).reshape(-1, 3)
