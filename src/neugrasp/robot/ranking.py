"""Which of the detected grasps is carried out: the first in the order of a strategy that can be.

After a failure, what is elsewhere may go first: a hand that slipped off a ball mostly slips off it again, and
two failures in a row end a round with everything else still on the table.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from neugrasp.detection.contract import Detection
from neugrasp.execution import Hand
from neugrasp.geometry.pose import Array
from neugrasp.grasp import Grasp, Grasps
from neugrasp.robot.errors import NoPlan, Refused
from neugrasp.robot.interface import Manipulator

Next = Callable[[Sequence[Grasp]], int]
"""Which of the grasps that are left is tried next."""
SAME_PLACE = 0.05
"""Metres beside a failure, seen from above, in which a grasp is taken to be at the same object."""
TRIES = 2
"""Failures at one place after which it is given up."""
GIVEN_UP = "failed there before"
"""Why a grasp at such a place is passed over."""


@dataclass(frozen=True)
class Skipped:
    """A grasp that was passed over."""

    index: int
    """In the detection."""
    reason: str
    """One of `errors.SKIPS`, or `GIVEN_UP`."""
    details: str
    """For people."""


@dataclass(frozen=True)
class Chosen:
    """A grasp with the hand that is ready for it, and what was passed over before."""

    index: int | None
    """In the detection; None where no grasp can be carried out."""
    hand: Hand | None
    skipped: tuple[Skipped, ...]

    @property
    def counts(self) -> dict[str, int]:
        """How many were passed over, by reason."""
        return dict(Counter(one.reason for one in self.skipped))

    @property
    def is_given_up(self) -> bool:
        """Whether grasps were detected, but only where others had failed too often."""
        return self.index is None and set(self.counts) == {GIVEN_UP}


def failures_near(grasps: Grasps, failed: Array, up: Array) -> Array:
    """How many of the TCP positions `failed` (n, 3), of grasps that failed, lie at the place of each grasp
    (g,): within `SAME_PLACE`, however high. `up` is the unit vector away from the table."""
    apart = np.array([grasp.position for grasp in grasps]).reshape(-1, 1, 3) - failed.reshape(1, -1, 3)
    beside = apart - (apart @ up)[..., None] * up
    return np.sum(np.linalg.norm(beside, axis=-1) <= SAME_PLACE, axis=1)


def first_possible(
    manipulator: Manipulator, detection: Detection, choose: Next, failures: Array | None = None
) -> Chosen:
    """Asks `choose` for one grasp after the other until the manipulator can carry one out. Nothing moves.

    Grasps with fewer `failures` (g,) near them go first; those with `TRIES` are passed over. Among equals,
    the detection's `margin` below the best one that is left bounds what may be chosen.
    """
    counts = np.zeros(len(detection.grasps), int) if failures is None else failures
    left = [int(i) for i in np.flatnonzero(counts < TRIES)]
    skipped = [
        Skipped(int(i), GIVEN_UP, f"{counts[i]} grasps failed there") for i in np.flatnonzero(counts >= TRIES)
    ]
    while left:
        first = [i for i in left if counts[i] == min(counts[left])]
        if detection.margin is not None:
            best = max(detection.grasps[i].score for i in first)
            first = [i for i in first if detection.grasps[i].score >= best - detection.margin]
        number = first[choose(detection.grasps[np.array(first)])]
        try:
            hand = manipulator.prepare(detection.grasps[number], detection)
        except (NoPlan, Refused) as error:
            skipped.append(Skipped(number, error.reason, str(error)))
            left.remove(number)
            continue
        return Chosen(number, hand, tuple(skipped))
    return Chosen(None, None, tuple(skipped))
