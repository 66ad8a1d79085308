"""One grasp, carried out by a robot cell: `execution.carry_out`, and what is to be done afterwards."""

from __future__ import annotations

from dataclasses import dataclass, replace

from neugrasp import execution
from neugrasp.execution import NOTHING_HELD, SUCCESS, Hand, carry_out
from neugrasp.geometry.pose import Array
from neugrasp.grasp import Grasp
from neugrasp.robot.errors import LeftOut
from neugrasp.robot.interface import Manipulator

COLLISION = "collision on the way"
SLIPPED = "slipped on lifting"
CARRIED_AWAY = "carried away from the table"
REASONS = (SUCCESS, COLLISION, NOTHING_HELD, SLIPPED, CARRIED_AWAY)
"""What a round counts."""
DROPPED = "dropped on the way"
"""Besides, where an arm carries what it holds."""


@dataclass(frozen=True)
class Pick:
    """What came of a grasp."""

    reason: str
    """One of `REASONS`, but for the last, which only a look at the table can tell; or `DROPPED`, or that of
    `LeftOut`."""
    opening: float
    """Between the pads at the end, metres."""
    touched: bool
    """Whether a contact stopped the hand before it was where it should close."""

    @property
    def success(self) -> bool:
        """Whether an object was taken off the table."""
        return self.reason == SUCCESS


def pick(manipulator: Manipulator, hand: Hand, grasp: Grasp, min_opening: float, up: Array) -> Pick:
    """Carries out a grasp (world frame) with the hand that was prepared for it; when it returns, the hand is
    out of the way and everything rests.

    A contact ends the approach and the fingers close there. Success is an object in the hand and more than
    `min_opening` metres between the pads after the retreat. `up` is the unit vector away from the table.
    """
    x, y, z = up.tolist()
    try:
        outcome = carry_out(hand, replace(grasp, up=(x, y, z)), min_opening)
    except LeftOut:
        manipulator.retract()
        return Pick(LeftOut.reason, hand.opening(), touched=False)
    opening = hand.opening()
    if not outcome.success:
        manipulator.retract()
        return Pick(_reason(outcome), opening, outcome.touched)
    arrived = manipulator.place_in_bin()
    return Pick(SUCCESS if arrived else DROPPED, opening, outcome.touched)


def _reason(outcome: execution.Outcome) -> str:
    """As a round counts: an empty hand that was stopped on its way has collided."""
    if outcome.reason == execution.SLIPPED:
        return SLIPPED
    return COLLISION if outcome.touched else NOTHING_HELD
