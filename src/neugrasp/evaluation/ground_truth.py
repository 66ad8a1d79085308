"""The ground truth of a simulated round: the errors of surfaces, and what lies on the table."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from neugrasp.detection.contract import Detection
from neugrasp.evaluation.declutter import SurfaceError
from neugrasp.geometry.fusion import vgn_grid
from neugrasp.metrics import CONSTANTS, l1_by_mask
from neugrasp.robot.simulated import SimulatedRobot
from neugrasp.robot.simulated_cameras import TruthCamera


@dataclass(frozen=True)
class SimulatedGroundTruth:
    """Compares with the 18-view surface, in the scale of the paper's L1: -1 where nothing is near."""

    robot: SimulatedRobot
    truth: TruthCamera
    judges: bool = True
    """Whether surfaces are judged at all: the 18 views take time."""

    def surface_error(self, detection: Detection) -> SurfaceError:
        """L1 by mask of the detected surface and of constant predictors."""
        if not self.judges or detection.tsdf is None:
            return SurfaceError({}, {})
        true = 2 * vgn_grid(self.truth.capture().tsdf) - 1
        constants = {f"{value:+.0f}": _defined(l1_by_mask(value, true)) for value in CONSTANTS}
        return SurfaceError(_defined(l1_by_mask(detection.tsdf, true)), constants)

    def describe(self) -> dict[str, Any]:
        """The scene as it lies now."""
        return asdict(self.robot.scene())


def _defined(errors: dict[str, float]) -> dict[str, float]:
    """Without the masks in which nothing lies: JSON has no NaN."""
    return {mask: error for mask, error in errors.items() if not math.isnan(error)}
