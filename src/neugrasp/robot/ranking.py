"""Which of the detected grasps is carried out: the first in the order of a strategy that can be."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from neugrasp.detection.contract import Detection
from neugrasp.execution import Hand
from neugrasp.grasp import Grasp
from neugrasp.robot.errors import NoPlan, Refused
from neugrasp.robot.interface import Manipulator

Next = Callable[[Sequence[Grasp]], int]
"""Which of the grasps that are left is tried next."""


@dataclass(frozen=True)
class Skipped:
    """A grasp that was passed over."""

    index: int
    """In the detection."""
    reason: str
    """One of `errors.SKIPS`."""
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


def first_possible(manipulator: Manipulator, detection: Detection, choose: Next) -> Chosen:
    """Asks `choose` for one grasp after the other until the manipulator can carry one out. Nothing moves."""
    left = list(range(len(detection.grasps)))
    skipped: list[Skipped] = []
    while left:
        number = left[choose(detection.grasps[np.array(left)])]
        try:
            hand = manipulator.prepare(detection.grasps[number], detection)
        except (NoPlan, Refused) as error:
            skipped.append(Skipped(number, error.reason, str(error)))
            left.remove(number)
            continue
        return Chosen(number, hand, tuple(skipped))
    return Chosen(None, None, tuple(skipped))
