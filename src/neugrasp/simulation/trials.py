"""Grasps executed in physics (method.md D2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neugrasp.errors import InputError
from neugrasp.grasp import Grasp
from neugrasp.simulation.hand import APPROACH
from neugrasp.simulation.physics import World

RULES = {"paper": 0.05, "vgn": 0.1}
"""Share of the largest opening that must remain between the fingers after the retreat."""
RETREAT = 0.10
SIDE_GRASP = np.pi / 3
"""From this angle between the approach and straight down on, the hand retreats upwards."""

SUCCESS = "success"
AT_PREGRASP = "collision at the pre-grasp"
ON_APPROACH = "collision on the approach"
NOTHING_HELD = "nothing between the fingers"
SLIPPED = "slipped"
REASONS = (SUCCESS, AT_PREGRASP, ON_APPROACH, NOTHING_HELD, SLIPPED)


@dataclass(frozen=True)
class Trial:
    """What came of a grasp."""

    success: bool
    reason: str
    """One of `REASONS`."""
    width: float
    """Opening at the end, metres; the largest opening where it failed."""
    body: int | None = None
    """Number of the body that is held."""


def execute(world: World, grasp: Grasp, rule: str = "paper", allow_contact: bool = False) -> Trial:
    """Carries out a grasp (TCP pose, workspace frame) and leaves the world as it then is, gripper included.

    With `allow_contact` a contact ends the approach and the fingers close there; without, it is a failure.
    Raises `InputError` on an unknown rule.
    """
    if rule not in RULES:
        raise InputError(f"unknown success rule {rule!r}; choose one of {', '.join(RULES)}")
    hand = world.hand()
    hand.place(grasp.advanced(-APPROACH).pose)
    world.detect_collisions()
    if hand.touches():
        return _failure(world, AT_PREGRASP)
    hand.move(grasp.position, until=hand.touches)
    if hand.touches() and not allow_contact:
        return _failure(world, ON_APPROACH)
    return lift(world, grasp, rule)


def lift(world: World, grasp: Grasp, rule: str) -> Trial:
    """Closes the hand where it is, retreats and looks at what is held."""
    hand = world.hand()
    threshold = RULES[rule] * world.gripper.max_opening

    def is_closed() -> bool:
        return hand.opening() <= threshold

    hand.close()
    if is_closed():
        return _failure(world, NOTHING_HELD)
    if np.arccos(np.clip(-grasp.approach[2], -1, 1)) > SIDE_GRASP:
        retreat = grasp.position + np.array([0, 0, RETREAT])
    else:
        retreat = grasp.advanced(-RETREAT).position
    # The fingers go on pressing: once they have met, nothing comes between them again.
    hand.move(retreat, until=is_closed)
    held = world.held()
    if held is None or is_closed():
        return _failure(world, SLIPPED)
    return Trial(True, SUCCESS, hand.opening(), held)


def foreseen(world: World, grasp: Grasp) -> str | None:
    """The collision with which `execute` without `allow_contact` must end, found by geometry alone.

    The hand follows its targets on a straight line and a known lag behind, so the places where `execute`
    looks for contacts are known, and nothing else moves before the first contact. No time passes here.
    """
    hand = world.hand()
    hand.place(grasp.advanced(-APPROACH).pose)
    world.detect_collisions()
    if hand.touches():
        return AT_PREGRASP
    # The end comes first: most collisions are there.
    for distance in reversed(world.approach.short):
        hand.shift(grasp.advanced(-distance).position)
        world.detect_collisions()
        if hand.touches():
            return ON_APPROACH
    return None


def _failure(world: World, reason: str) -> Trial:
    return Trial(False, reason, world.gripper.max_opening)
