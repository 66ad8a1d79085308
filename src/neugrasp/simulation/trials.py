"""Grasps executed in physics (method.md D2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array
from neugrasp.grasp import Grasp
from neugrasp.simulation.physics import World

RULES = {"paper": 0.05, "vgn": 0.1}
"""Share of the largest opening that must remain between the fingers after the retreat."""

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
    check_rule(rule)
    hand = world.hand()
    hand.place(grasp.pregrasp)
    world.detect_collisions()
    if hand.touches():
        return failure(world, AT_PREGRASP)
    hand.move(grasp.position, until=hand.touches)
    if hand.touches() and not allow_contact:
        return failure(world, ON_APPROACH)
    return lift(world, grasp, rule)


def end_of_retreat(grasp: Grasp) -> Array:
    """Where the TCP goes with what it holds, in a world whose z is up."""
    return replace(grasp, up=(0.0, 0.0, 1.0)).retreat[:3, 3]


def check_rule(rule: str) -> None:
    """Raises `InputError` on an unknown rule."""
    if rule not in RULES:
        raise InputError(f"unknown success rule {rule!r}; choose one of {', '.join(RULES)}")


def never() -> bool:
    """No reason to stop."""
    return False


def lift(
    world: World,
    grasp: Grasp,
    rule: str,
    is_closed_early: Callable[[], bool] = never,
    is_carried_early: Callable[[], bool] = never,
) -> Trial:
    """Closes the hand where it is, retreats and looks at what is held.

    The two callables are asked every 1/60 s whether closing, and carrying, can end before their time.
    """
    hand = world.hand()
    threshold = RULES[rule] * world.gripper.max_opening

    def is_closed() -> bool:
        return hand.opening() <= threshold

    hand.close(until=is_closed_early)
    if is_closed():
        return failure(world, NOTHING_HELD)
    # The fingers go on pressing: once they have met, nothing comes between them again.
    hand.move(end_of_retreat(grasp), until=lambda: is_closed() or is_carried_early())
    held = world.held()
    if held is None or is_closed():
        return failure(world, SLIPPED)
    return Trial(True, SUCCESS, hand.opening(), held)


def failure(world: World, reason: str) -> Trial:
    """A trial that ended badly."""
    return Trial(False, reason, world.gripper.max_opening)
