"""One execution of a grasp, for labels, validation, rounds and real cells alike (docs/benchmark.md).

Open, go to the pre-grasp, approach in a straight line, close, retreat in a straight line, look what is held.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from neugrasp.geometry.pose import Array
from neugrasp.grasp import Grasp

MIN_OPENING = {"paper": 0.05, "vgn": 0.1, "graspnerf": 0.1}
"""By the rule of a success: share of the largest opening that must remain between the fingers."""

SUCCESS = "success"
AT_PREGRASP = "collision at the pre-grasp"
ON_APPROACH = "collision on the approach"
NOTHING_HELD = "nothing between the fingers"
SLIPPED = "slipped"
REASONS = (SUCCESS, AT_PREGRASP, ON_APPROACH, NOTHING_HELD, SLIPPED)


class Hand(Protocol):
    """What carries out a grasp: a gripper at the end of an arm. Poses and positions are the TCP's, metres."""

    def open(self) -> None:
        """Opens as far as it goes."""
        ...

    def move_to_pose(self, pose: Array, /) -> bool:
        """Brings the open hand to a pose (4, 4) on a way of its own; False where it cannot without touching
        something."""
        ...

    def move_straight(self, position: Array, stop_on_contact: bool) -> bool:
        """Leads the TCP along a line to a position (3,); whether a contact stopped it on the way."""
        ...

    def close(self) -> None:
        """Closes until something or the other finger resists, and goes on pressing."""
        ...

    def opening(self) -> float:
        """The distance between the pads, metres."""
        ...

    def holds(self) -> bool:
        """Whether an object touches the hand."""
        ...


@dataclass(frozen=True)
class Outcome:
    """What came of a grasp."""

    reason: str
    """One of `REASONS`."""
    touched: bool = False
    """Whether a contact stopped the hand before it was where it should close."""

    @property
    def success(self) -> bool:
        """Whether an object was lifted."""
        return self.reason == SUCCESS


def carry_out(
    hand: Hand, grasp: Grasp, min_opening: float, allow_contact: bool = True, retreats_empty: bool = True
) -> Outcome:
    """Carries out a grasp and leaves the hand where it then is.

    With `allow_contact` a contact ends the approach and the fingers close there; without, it is a failure.
    An empty hand retreats, too, unless `retreats_empty` is False: a simulation whose state is thrown away.
    Success is an object in the hand and more than `min_opening` metres between the pads after the retreat.
    """
    hand.open()
    if not hand.move_to_pose(grasp.pregrasp):
        return Outcome(AT_PREGRASP, touched=True)
    touched = hand.move_straight(grasp.position, stop_on_contact=True)
    if touched and not allow_contact:
        return Outcome(ON_APPROACH, touched)
    return lift(hand, grasp, min_opening, retreats_empty, touched)


def lift(
    hand: Hand, grasp: Grasp, min_opening: float, retreats_empty: bool = True, touched: bool = False
) -> Outcome:
    """The second half of `carry_out`: closes the hand where it is, retreats, looks what is held."""
    hand.close()
    is_empty = hand.opening() <= min_opening
    if not is_empty or retreats_empty:
        hand.move_straight(grasp.retreat[:3, 3], stop_on_contact=False)
    if is_empty:
        return Outcome(NOTHING_HELD, touched)
    if hand.opening() <= min_opening or not hand.holds():
        return Outcome(SLIPPED, touched)
    return Outcome(SUCCESS, touched)
