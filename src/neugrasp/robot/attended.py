"""Arms and grippers that are attended: before anything moves, somebody is told, and may end it all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from neugrasp.detection.contract import Detection
from neugrasp.execution import Hand
from neugrasp.grasp import Grasp
from neugrasp.robot.interface import Arm, ArmState, Gripper, Manipulator, StopsOnLeaving
from neugrasp.robot.trajectory import Trajectory


@dataclass(frozen=True)
class Step:
    """What is done next, by arm or gripper."""

    what: str
    """In words for people."""
    motion: Trajectory | None = None
    """Motion of the arm; None: the gripper moves, or a grasp is begun."""
    until_contact: bool = False
    """Whether a contact ends the motion."""
    opening: float = 0.0
    """Metres between the pads that the gripper goes to."""
    force: float = 0.0
    """Newton with which it presses."""
    grasp: Grasp | None = None
    """The grasp that is begun, in the frame that is planned in."""


class Attendant(Protocol):
    """Who is told."""

    def meet(self, arm: Arm) -> None:
        """The arm that is attended, before it first moves. Its `stop` works from any thread."""
        ...

    def before(self, step: Step) -> None:
        """Returns when it may be done. Raises `Stopped` to end everything, `LeftOut` to leave this grasp."""
        ...


class AttendedArm(StopsOnLeaving):
    """An arm whose attendants are told of every motion."""

    def __init__(self, arm: Arm, *attendants: Attendant):
        self._arm, self._attendants = arm, attendants
        for attendant in attendants:
            attendant.meet(self)

    def state(self) -> ArmState:
        """As `Arm.state`."""
        return self._arm.state()

    def execute(self, motion: Trajectory, until_contact: bool, timeout_s: float) -> bool:
        """As `Arm.execute`. Raises what an attendant raises, too; nothing has moved then."""
        step = Step(motion.what or "a motion", motion, until_contact)
        for attendant in self._attendants:
            attendant.before(step)
        return self._arm.execute(motion, until_contact, timeout_s)

    def stop(self) -> None:
        """As `Arm.stop`."""
        self._arm.stop()


class AttendedGripper:
    """A gripper whose attendants are told of every movement."""

    def __init__(self, gripper: Gripper, *attendants: Attendant):
        self._gripper, self._attendants = gripper, attendants

    @property
    def max_opening(self) -> float:
        """Largest distance between the pads, metres."""
        return self._gripper.max_opening

    def move(self, opening: float, force: float, timeout_s: float) -> float:
        """As `Gripper.move`. Raises what an attendant raises, too; nothing has moved then."""
        step = Step("gripper opens" if opening > 0 else "gripper closes", opening=opening, force=force)
        for attendant in self._attendants:
            attendant.before(step)
        return self._gripper.move(opening, force, timeout_s)

    def opening(self) -> float:
        """The distance between the pads, metres."""
        return self._gripper.opening()

    def holds(self) -> bool:
        """As `Gripper.holds`."""
        return self._gripper.holds()


class AttendedManipulator:
    """A manipulator whose attendants are told of every grasp that can be carried out, before it begins."""

    def __init__(self, manipulator: Manipulator, *attendants: Attendant):
        self._manipulator, self._attendants = manipulator, attendants

    @property
    def max_opening(self) -> float:
        """Largest distance between the pads, metres."""
        return self._manipulator.max_opening

    def prepare(self, grasp: Grasp, detection: Detection) -> Hand:
        """As `Manipulator.prepare`. Raises `LeftOut` where an attendant does not want the grasp."""
        hand = self._manipulator.prepare(grasp, detection)
        what = f"a grasp of score {grasp.score:.2f}, {1000 * grasp.width:.0f} mm wide"
        for attendant in self._attendants:
            attendant.before(Step(what, grasp=grasp))
        return hand

    def place_in_bin(self) -> bool:
        """As `Manipulator.place_in_bin`."""
        return self._manipulator.place_in_bin()

    def retract(self) -> None:
        """As `Manipulator.retract`."""
        self._manipulator.retract()
