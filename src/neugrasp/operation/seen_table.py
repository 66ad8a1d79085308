"""A real table: nobody counts what lies on it, but the photos show whether anything does."""

from __future__ import annotations

from typing import Any

import numpy as np

from neugrasp.change_mask import OBJECT, change_labels
from neugrasp.detection.contract import Detection
from neugrasp.evaluation.declutter import SurfaceError
from neugrasp.observation import Views
from neugrasp.robot.interface import Camera

SMALLEST = 0.002
"""Share of a photo that an object fills: a cube of 2 cm at half a metre."""


class SeenTable:
    """Camera and table in one: the count is 1 as long as the last photos show something, else 0."""

    def __init__(self, camera: Camera[Views]):
        self._camera = camera
        self._shows_something = True

    def capture(self) -> Views:
        """The photos; they are remembered for the count."""
        seen = self._camera.capture()
        shares = [np.mean(change_labels(v.image, v.background) == OBJECT) for v in seen.frames]
        self._shows_something = max(map(float, shares)) > SMALLEST
        return seen

    def count(self) -> int:
        """1, or 0 where the last photos show the empty table."""
        return int(self._shows_something)


class NoGroundTruth:
    """The truth of a real table: nothing is known."""

    def surface_error(self, detection: Detection) -> SurfaceError:
        """Nothing."""
        return SurfaceError({}, {})

    def describe(self) -> dict[str, Any]:
        """Nothing."""
        return {}
