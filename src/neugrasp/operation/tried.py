"""Grasps that were tried in a scene, as the labels that training reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from neugrasp.data.labels import GraspLabels
from neugrasp.geometry.pose import inverse, to_quaternion
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper


@dataclass(frozen=True)
class Tried:
    """A grasp, and what came of it."""

    grasp: Grasp
    """In the user's world."""
    success: bool
    opening: float
    """Between the pads at the end, metres."""


def labels_of(tried: Sequence[Tried], workspace: Workspace, gripper: Gripper) -> GraspLabels:
    """The labels of a scene: grasp points in the frame of its cube, not the TCP."""
    workspace_from_world = inverse(workspace.world_from_workspace)
    poses = [one.grasp.moved(workspace_from_world).advanced(-gripper.tcp_depth).pose for one in tried]
    widths = [one.opening if one.success else gripper.max_opening for one in tried]
    return GraspLabels(
        points=np.array([pose[:3, 3] for pose in poses], np.float32).reshape(-1, 3),
        quaternions=np.array([to_quaternion(pose) for pose in poses], np.float32).reshape(-1, 4),
        widths=np.array(widths, np.float32),
        success=np.array([one.success for one in tried], np.bool_),
    )
