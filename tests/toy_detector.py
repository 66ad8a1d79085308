"""A detector that is not of the package: straight down where the first photo changed most."""

from __future__ import annotations

import numpy as np

from neugrasp.detection.contract import Detection
from neugrasp.detection.registry import PHOTOS, DetectorSpec
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Observation, with_backgrounds


class Downwards:
    """Finds one grasp, 3 cm above the table."""

    def detect(self, seen: Observation) -> Detection:
        """The grasp, without a surface."""
        workspace, view = seen.workspace, with_backgrounds(seen).frames[0]
        change = np.abs(view.image.astype(float) - view.background).sum(axis=-1)
        row, column = np.unravel_index(change.argmax(), change.shape)
        ray = view.camera.unproject((column, row), 1.0) - view.camera.centre
        height = workspace.to_world(workspace.centre)[2] + 0.03
        pose = np.diag([1.0, -1.0, -1.0, 1.0])  # z down: the hand comes from above
        pose[:3, 3] = view.camera.centre + ray * (height - view.camera.centre[2]) / ray[2]
        return Detection(Grasps.of([Grasp(pose, 0.04, 0.5)]), workspace, Gripper.load("panda"))


SPEC = DetectorSpec(PHOTOS, lambda _config: Downwards())
