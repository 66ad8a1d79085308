"""Why there are so many grasps and no more, or none: one sentence from the counts of a detection."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from neugrasp.grasp import Grasps


class Told(Protocol):
    """What is said of a `Detection`."""

    @property
    def grasps(self) -> Grasps: ...

    @property
    def rejected(self) -> Mapping[str, int]: ...

    @property
    def best_rejected(self) -> float | None: ...

    @property
    def threshold(self) -> float | None: ...

    @property
    def timing_s(self) -> Mapping[str, float]: ...


WORDS = {
    "off_the_surface": "off the surface",
    "too_narrow": "too narrow to be real",
    "too_wide_for_the_gripper": "too wide for the gripper",
    "hand_would_collide": "where the hand would touch something",
    "nothing_between_the_fingers": "with nothing between the fingers",
    "held_by_the_rim": "where the fingers would hold a rim only, and others hold more",
    "not_the_best_nearby": "beside a better one",
    "outside_the_region": "outside of the region",
    "outside_the_mask": "outside of the mask",
    "from_another_side": "from another side than the approach asked for",
    "too_low": "lower than the least height",
    "on_another_object": "on another object than the best",
    "beyond_the_best": "beyond the best that were asked for",
}


def explain(detection: Told) -> str:
    """ "0 of 64,000: 61,220 off the surface, 2,514 below 0.9 (best 0.83), 266 too wide for the gripper"."""
    total = len(detection.grasps) + sum(detection.rejected.values())
    if not total:
        return "nothing stands on the table where the hand could come to it"
    text = f"{len(detection.grasps):,} of {total:,}"
    if reasons := reasons_of(detection):
        text += ": " + ", ".join(f"{count:,} {words}" for words, count in reasons)
    return text


def reasons_of(detection: Told) -> list[tuple[str, int]]:
    """Every reason in words with the number of candidates it rejected, in the order of the rules."""
    return [(_words(reason, detection), count) for reason, count in detection.rejected.items() if count]


def _words(reason: str, detection: Told) -> str:
    if reason == "quality_below_threshold":
        limit = "the threshold" if detection.threshold is None else f"{detection.threshold:g}"
        return f"below {limit} (best {detection.best_rejected:.2f})"
    return WORDS.get(reason, reason.replace("_", " "))
