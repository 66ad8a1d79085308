"""One grasp, carried out: approach, close, retreat, look whether it holds (method.md D2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from neugrasp.geometry.pose import Array
from neugrasp.grasp import Grasp
from neugrasp.robot.interface import Arm, Gripper

SUCCESS = "success"
COLLISION = "collision on the way"
NOTHING_HELD = "nothing between the fingers"
SLIPPED = "slipped on lifting"
CARRIED_AWAY = "carried away from the table"
REASONS = (SUCCESS, COLLISION, NOTHING_HELD, SLIPPED, CARRIED_AWAY)


@dataclass(frozen=True)
class Pick:
    """What came of a grasp."""

    reason: str
    """One of `REASONS`, but for the last, which only a look at the table can tell."""
    opening: float
    """Between the pads at the end, metres."""
    touched: bool
    """Whether a contact stopped the hand before it was where it should close."""

    @property
    def success(self) -> bool:
        """Whether an object was taken off the table."""
        return self.reason == SUCCESS


def pick(arm: Arm, gripper: Gripper, grasp: Grasp, min_opening: float, up: Array) -> Pick:
    """Carries out a grasp (world frame); when it returns, the hand is out of the way and everything rests.

    A contact ends the approach and the fingers close there. Success is an object in the hand and more than
    `min_opening` metres between the pads after the retreat. `up` is the unit vector away from the table.
    """
    gripper.open()
    x, y, z = up.tolist()
    grasp = replace(grasp, up=(x, y, z))
    if not arm.go_to(grasp.pregrasp):
        return _failed(arm, gripper, COLLISION, touched=True)
    touched = arm.move_straight(grasp.position, stop_on_contact=True)
    gripper.close()
    is_empty = gripper.opening() <= min_opening
    arm.move_straight(grasp.retreat[:3, 3], stop_on_contact=False)
    if is_empty:
        return _failed(arm, gripper, COLLISION if touched else NOTHING_HELD, touched)
    if gripper.opening() <= min_opening or not gripper.holds():
        return _failed(arm, gripper, SLIPPED, touched)
    opening = gripper.opening()
    arm.deliver()
    return Pick(SUCCESS, opening, touched)


def _failed(arm: Arm, gripper: Gripper, reason: str, touched: bool) -> Pick:
    opening = gripper.opening()
    arm.leave()
    return Pick(reason, opening, touched)
