"""Grasps executed in physics, each for itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from neugrasp import execution
from neugrasp.errors import InputError
from neugrasp.execution import MIN_OPENING
from neugrasp.geometry.pose import Array
from neugrasp.grasp import Grasp
from neugrasp.simulation.physics import World


@dataclass(frozen=True)
class Trial:
    """What came of a grasp."""

    success: bool
    reason: str
    """One of `execution.REASONS`."""
    width: float
    """Opening at the end, metres; the largest opening where it failed."""
    body: int | None = None
    """Number of the body that is held."""


def never() -> bool:
    """No reason to stop."""
    return False


@dataclass(frozen=True)
class WorldHand:
    """The hand of a world, as `execution` leads it: what it does ends as soon as nothing more can come of it.

    The two callables are asked every 1/60 s whether closing, and carrying, can end before their time.
    """

    world: World
    min_opening: float
    """Opening in metres at which the fingers have met, and nothing comes between them again."""
    is_closed_early: Callable[[], bool] = never
    is_carried_early: Callable[[], bool] = never

    def open(self) -> None:
        """Nothing to do: `move_to_pose` brings the hand open."""

    def move_to_pose(self, pose: Array) -> bool:
        """Puts the open hand at a pose; False where it touches something there."""
        hand = self.world.hand()
        hand.place(pose)
        self.world.detect_collisions()
        return not hand.touches()

    def move_straight(self, position: Array, stop_on_contact: bool) -> bool:
        """Leads the hand along a line; whether a contact stopped it."""
        hand = self.world.hand()
        if stop_on_contact:
            hand.move(position, until=hand.touches)
            return hand.touches()
        hand.move(position, until=lambda: self._has_met() or self.is_carried_early())
        return False

    def close(self) -> None:
        """Closes; the fingers go on pressing."""
        self.world.hand().close(until=self.is_closed_early)

    def opening(self) -> float:
        """The distance between the pads, metres."""
        return self.world.hand().opening()

    def holds(self) -> bool:
        """Whether an object touches the hand."""
        return self.world.held() is not None

    def lift(self, grasp: Grasp) -> Trial:
        """Closes where the hand is, and lifts."""
        return self.trial(
            execution.lift(self, _upright(grasp), self.min_opening, retreats_empty=False).reason
        )

    def trial(self, reason: str) -> Trial:
        """The trial that ends with a reason."""
        if reason != execution.SUCCESS:
            return failure(self.world, reason)
        return Trial(True, reason, self.opening(), self.world.held())

    def _has_met(self) -> bool:
        return self.opening() <= self.min_opening


def execute(world: World, grasp: Grasp, rule: str = "paper", allow_contact: bool = False) -> Trial:
    """Carries out a grasp (TCP pose, workspace frame) and leaves the world as it then is, gripper included.

    With `allow_contact` a contact ends the approach and the fingers close there; without, it is a failure.
    Raises `InputError` on an unknown rule.
    """
    hand = WorldHand(world, min_opening(world, rule))
    outcome = execution.carry_out(
        hand, _upright(grasp), hand.min_opening, allow_contact, retreats_empty=False
    )
    return hand.trial(outcome.reason)


def end_of_retreat(grasp: Grasp) -> Array:
    """Where the TCP goes with what it holds, in a world whose z is up."""
    return _upright(grasp).retreat[:3, 3]


def min_opening(world: World, rule: str) -> float:
    """Metres that must remain between the pads. Raises `InputError` on an unknown rule."""
    if rule not in MIN_OPENING:
        raise InputError(f"unknown success rule {rule!r}; choose one of {', '.join(MIN_OPENING)}")
    return MIN_OPENING[rule] * world.gripper.max_opening


def failure(world: World, reason: str) -> Trial:
    """A trial that ended badly."""
    return Trial(False, reason, world.gripper.max_opening)


def _upright(grasp: Grasp) -> Grasp:
    return replace(grasp, up=(0.0, 0.0, 1.0))
