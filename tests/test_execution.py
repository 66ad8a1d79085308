"""One way to carry out a grasp: the order of the moves, and which failure is which."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from neugrasp.execution import (
    AT_PREGRASP,
    NOTHING_HELD,
    ON_APPROACH,
    SLIPPED,
    SUCCESS,
    carry_out,
)
from neugrasp.geometry.pose import Array, rigid
from neugrasp.grasp import Grasp

GRASP = Grasp(rigid(np.diag([1.0, -1.0, -1.0]), (0.1, 0.2, 0.3)), 0.04)


@dataclass
class Script:
    """A hand whose answers are written down before."""

    is_free: bool = True
    touches: bool = False
    openings: tuple[float, float] = (0.04, 0.04)
    """After closing, after the retreat."""
    is_held: bool = True
    said: list[str] = field(default_factory=list)

    def open(self) -> None:
        self.said.append("open")

    def move_to_pose(self, pose: Array) -> bool:
        assert np.allclose(pose[:3, 3], (0.1, 0.2, 0.35))
        self.said.append("go")
        return self.is_free

    def move_straight(self, position: Array, stop_on_contact: bool) -> bool:
        assert np.allclose(position, (0.1, 0.2, 0.3 if stop_on_contact else 0.4))
        self.said.append("approach" if stop_on_contact else "retreat")
        return stop_on_contact and self.touches

    def close(self) -> None:
        self.said.append("close")

    def opening(self) -> float:
        return self.openings["retreat" in self.said]

    def holds(self) -> bool:
        return self.is_held


WHOLE = ["open", "go", "approach", "close", "retreat"]


@pytest.mark.parametrize(
    ("hand", "allows", "reason", "touched", "said"),
    [
        (Script(), True, SUCCESS, False, WHOLE),
        (Script(touches=True), True, SUCCESS, True, WHOLE),
        (Script(touches=True), False, ON_APPROACH, True, WHOLE[:3]),
        (Script(is_free=False), True, AT_PREGRASP, True, WHOLE[:2]),
        (Script(openings=(0.004, 0.0)), True, NOTHING_HELD, False, WHOLE),
        (Script(openings=(0.04, 0.0)), True, SLIPPED, False, WHOLE),
        (Script(is_held=False), True, SLIPPED, False, WHOLE),
    ],
)
def test_each_failure_is_what_it_is(hand: Script, allows: bool, reason: str, touched: bool, said: list[str]):
    outcome = carry_out(hand, GRASP, 0.004, allow_contact=allows)
    assert (outcome.reason, outcome.touched, outcome.success) == (reason, touched, reason == SUCCESS)
    assert hand.said == said


def test_a_simulation_that_is_thrown_away_does_not_retreat_empty():
    hand = Script(openings=(0.0, 0.0))
    assert carry_out(hand, GRASP, 0.004, retreats_empty=False).reason == NOTHING_HELD
    assert hand.said == WHOLE[:-1]
