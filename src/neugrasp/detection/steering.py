"""Which of the detected grasps are wanted: where, from which side, how many."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from neugrasp.errors import InputError

if TYPE_CHECKING:
    from neugrasp.detection.detector import Detection
    from neugrasp.geometry.workspace import Workspace
    from neugrasp.grasp import Grasp

Box = tuple[float, float, float, float, float, float]
Cone = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Steering:
    """What a grasp must satisfy besides; everything in the world of the scene."""

    region: Box | None = None
    """Box in which the point between the fingertips must lie: x, y and z from, x, y and z to, metres."""
    approach: Cone | None = None
    """Direction x, y, z in which the hand may move to the grasp, and by how many degrees it may deviate:
    0 0 -1 30 is from above."""
    min_height: float | None = None
    """Least height of the point between the fingertips above the table, metres."""
    top: int | None = None
    """So many grasps at most, the best."""

    def __post_init__(self) -> None:
        if self.region is not None and not all(self.region[i] < self.region[i + 3] for i in range(3)):
            raise InputError(f"--region {_words(self.region)}: give the lower corner, then the upper one")
        if self.approach is not None:
            *direction, degrees = self.approach
            if not 0 < float(np.linalg.norm(direction)) < np.inf or not 0 < degrees <= 180:
                raise InputError(
                    f"--approach {_words(self.approach)}: a direction that is not 0, then 0 to 180 degrees"
                )
        if self.top is not None and self.top < 1:
            raise InputError(f"--top {self.top}: must be at least 1")

    def applied(self, detection: Detection, workspace: Workspace) -> Detection:
        """The detection with the wanted grasps alone, the others counted by reason."""
        kept, rejected = detection.grasps, dict(detection.rejected)
        rules = {
            "outside_the_region": self._is_inside,
            "from_another_side": self._is_approached,
            "too_low": lambda grasp: self._is_high(grasp, workspace),
        }
        for reason, is_wanted in rules.items():
            wanted = tuple(grasp for grasp in kept if is_wanted(grasp))
            if len(wanted) < len(kept):
                rejected[reason] = len(kept) - len(wanted)
            kept = wanted
        if self.top is not None and len(kept) > self.top:
            rejected["beyond_the_best"] = len(kept) - self.top
            kept = kept[: self.top]
        return replace(detection, grasps=kept, rejected=rejected)

    def _is_inside(self, grasp: Grasp) -> bool:
        if self.region is None:
            return True
        low, high = np.array(self.region[:3]), np.array(self.region[3:])
        return bool(np.all((grasp.position >= low) & (grasp.position <= high)))

    def _is_approached(self, grasp: Grasp) -> bool:
        if self.approach is None:
            return True
        *direction, degrees = self.approach
        cosine = grasp.approach @ np.array(direction) / np.linalg.norm(direction)
        return bool(np.degrees(np.arccos(np.clip(cosine, -1, 1))) <= degrees + 1e-9)

    def _is_high(self, grasp: Grasp, workspace: Workspace) -> bool:
        if self.min_height is None:
            return True
        up, origin = workspace.world_from_workspace[:3, 2], workspace.world_from_workspace[:3, 3]
        return bool((grasp.position - origin) @ up - workspace.table_height >= self.min_height)


def _words(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:g}" for number in numbers)
