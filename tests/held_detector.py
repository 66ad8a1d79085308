"""A detector that sees a flat table and two grasps, as soon as it is let go: for servers under load."""

from __future__ import annotations

import threading

import numpy as np

from neugrasp.detection.contract import Detection
from neugrasp.detection.registry import PHOTOS, DetectorSpec
from neugrasp.geometry.pose import rigid
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Observation

DOWN = np.diag([1.0, -1.0, -1.0])
LET_GO = threading.Event()
"""While it is not set, detections wait."""
LET_GO.set()
BEGUN = threading.Semaphore(0)
"""Counts the detections that have begun."""


class FlatTable:
    """Two grasps at the middle of the cube, 6 cm and 7 cm above its floor."""

    def detect(self, seen: Observation) -> Detection:
        """Waits, then finds."""
        BEGUN.release()
        if not LET_GO.wait(30):
            raise RuntimeError("nobody let this detector go")
        workspace = seen.workspace
        height = workspace.voxel_centres()[..., 2] - workspace.table_height
        tsdf = (height / workspace.truncation).clip(-1, 1).astype(np.float32)
        middle = workspace.centre[:2]
        poses = [workspace.world_from_workspace @ rigid(DOWN, (*middle, z)) for z in (0.06, 0.07)]
        grasps = Grasps.of(Grasp(pose, 0.04, 0.9 - 0.1 * i) for i, pose in enumerate(poses))
        return Detection(
            grasps, workspace, Gripper.load("panda"), tsdf, {"too_narrow": 7}, 0.5, None, {"look": 0.01}
        )


SPEC = DetectorSpec(PHOTOS, lambda _options: FlatTable())
