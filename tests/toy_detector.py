"""A detector that is not of the package: straight down where the first photo changed most."""

from __future__ import annotations

import numpy as np

from neugrasp.detection.detector import Detection
from neugrasp.evaluation.detector_registry import DetectorSpec
from neugrasp.grasp import Grasp
from neugrasp.views import Views


class Downwards:
    """Finds one grasp, 3 cm above the table."""

    def detect(self, views: Views) -> Detection:
        """The grasp, and an empty surface."""
        workspace, view = views.workspace, views.views[0]
        change = np.abs(view.image.astype(float) - view.background).sum(axis=-1)
        row, column = np.unravel_index(change.argmax(), change.shape)
        ray = view.camera.unproject((column, row), 1.0) - view.camera.centre
        height = workspace.to_world(workspace.centre)[2] + 0.03
        pose = np.diag([1.0, -1.0, -1.0, 1.0])  # z down: the hand comes from above
        pose[:3, 3] = view.camera.centre + ray * (height - view.camera.centre[2]) / ray[2]
        grid = np.ones((workspace.resolution,) * 3, dtype=np.float32)
        return Detection((Grasp(pose, 0.04, 0.5),), grid, {}, 0.0, {})


SPEC = DetectorSpec("photos", lambda _config: Downwards())
