"""Which of the detected grasps are wanted: where, from which side, how many."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from neugrasp.detection.contract import Detection
from neugrasp.detection.options import Steering
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp


def steered(detection: Detection, steering: Steering) -> Detection:
    """The detection with the wanted grasps alone, the others counted by reason."""
    kept, rejected = detection.grasps, dict(detection.rejected)
    rules = {
        "outside_the_region": lambda grasp: _is_inside(steering, grasp),
        "from_another_side": lambda grasp: _is_approached(steering, grasp),
        "too_low": lambda grasp: _is_high(steering, grasp, detection.workspace),
    }
    for reason, is_wanted in rules.items():
        wanted = kept[np.array([is_wanted(grasp) for grasp in kept], dtype=bool)]
        if len(wanted) < len(kept):
            rejected[reason] = len(kept) - len(wanted)
        kept = wanted
    if steering.top is not None and len(kept) > steering.top:
        rejected["beyond_the_best"] = len(kept) - steering.top
        kept = kept[: steering.top]
    return replace(detection, grasps=kept, rejected=rejected)


def _is_inside(steering: Steering, grasp: Grasp) -> bool:
    if steering.region is None:
        return True
    low, high = np.array(steering.region[:3]), np.array(steering.region[3:])
    return bool(np.all((grasp.position >= low) & (grasp.position <= high)))


def _is_approached(steering: Steering, grasp: Grasp) -> bool:
    if steering.approach is None:
        return True
    *direction, degrees = steering.approach
    cosine = grasp.approach @ np.array(direction) / np.linalg.norm(direction)
    return bool(np.degrees(np.arccos(np.clip(cosine, -1, 1))) <= degrees + 1e-9)


def _is_high(steering: Steering, grasp: Grasp, workspace: Workspace) -> bool:
    if steering.min_height is None:
        return True
    up, origin = workspace.world_from_workspace[:3, 2], workspace.world_from_workspace[:3, 3]
    return bool((grasp.position - origin) @ up - workspace.table_height >= steering.min_height)
