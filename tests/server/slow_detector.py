"""As `held_detector`, but each detection takes a second, whoever waits: for a server in another process."""

from __future__ import annotations

import time

from held_detector import FlatTable
from neugrasp.detection.contract import Detection
from neugrasp.detection.registry import PHOTOS, DetectorSpec
from neugrasp.observation import Observation


class SlowTable(FlatTable):
    """Two grasps, a second later."""

    def detect(self, seen: Observation) -> Detection:
        """Waits, then finds."""
        time.sleep(1.0)
        return super().detect(seen)


SPEC = DetectorSpec(PHOTOS, lambda _options: SlowTable())
