"""What a robot cell can do, simulated or real. The benchmark and `neugrasp run` know nothing else.

Two levels. `Camera`, `Manipulator` and `Table` are what a loop needs that clears tables. `Arm` and `Gripper`
are what drivers offer, and what `robot.arm_hand` makes a manipulator of. Poses are those of the TCP in the
user's world, metres; joints are radians. Every wait has an end; what goes wrong is a `RobotError`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from types import TracebackType
from typing import Generic, Protocol, Self, TypeVar, runtime_checkable

from neugrasp.detection.contract import Detection
from neugrasp.execution import Hand
from neugrasp.geometry.pose import Array
from neugrasp.grasp import Grasp
from neugrasp.observation import Image
from neugrasp.robot.trajectory import Trajectory

Seen = TypeVar("Seen", covariant=True)


class Camera(Protocol[Seen]):
    """The cameras of a cell, or one camera on the wrist that is driven around."""

    def capture(self) -> Seen:
        """What lies on the table now: `Views` from a camera for photos, `DepthViews` from one for depth."""
        ...


class Manipulator(Protocol):
    """What carries out grasps: a floating hand in physics, or an arm that plans its ways."""

    @property
    def max_opening(self) -> float:
        """Largest distance between the pads, metres."""
        ...

    def prepare(self, grasp: Grasp, detection: Detection) -> Hand:
        """A hand that can carry a grasp (world frame) out from here, past what was detected.

        Raises `NoPlan` where it cannot, with the reason, and `Refused` where it must not; nothing has moved.
        """
        ...

    def place_in_bin(self) -> bool:
        """Takes what is held off the table and the hand out of sight; returns when all that is left rests:
        whether it was held all the way."""
        ...

    def retract(self) -> None:
        """Lets go and takes the hand out of sight; returns when everything rests."""
        ...


class Table(Protocol):
    """Who counts what is left: physics in simulation, a person beside a real table."""

    def count(self) -> int:
        """How many objects lie in the workspace."""
        ...


@dataclass(frozen=True)
class Robot(Generic[Seen]):
    """A cell with everything in it."""

    camera: Camera[Seen]
    manipulator: Manipulator
    table: Table


@dataclass(frozen=True)
class ArmState:
    """An arm at one moment."""

    joints: Array
    """(6,) radians, as measured."""
    speeds: Array
    """(6,) rad/s."""
    stamp: float
    """Seconds, by the clock of `time.monotonic`, or of the simulation."""


class Arm(Protocol):
    """A driver of an arm. As a context it leaves the arm still, whatever happened."""

    def __enter__(self) -> Arm: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def state(self) -> ArmState:
        """Where the arm is. Raises `ConnectionLost` where the news is old."""
        ...

    def execute(self, motion: Trajectory, until_contact: bool, timeout_s: float) -> bool:
        """Carries a motion out; whether a contact ended it, which it does where `until_contact`.

        Raises `MotionTimeout`, `Stopped`, `ProtectiveStop`, `EmergencyStop` or `ConnectionLost`; the arm
        stands still then.
        """
        ...

    def stop(self) -> None:
        """Ends a motion at once, from whichever thread; returns when the arm was told."""
        ...


class StopsOnLeaving(ABC):
    """A context that stops when it is left."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    @abstractmethod
    def stop(self) -> None:
        """As `Arm.stop`."""
        ...


@runtime_checkable
class Guidable(Protocol):
    """What else an arm can do that a person may lead by hand."""

    def release(self) -> None:
        """Lets a person move the arm until `hold`; it carries its own weight."""
        ...

    def hold(self) -> None:
        """Stands where it was led."""
        ...


class Sensor(Protocol):
    """A driver of a camera. As a context it lets the camera go."""

    def __enter__(self) -> Sensor: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def photo(self, timeout_s: float) -> Image:
        """What is seen from now on, RGB. Raises `CameraFault` where nothing still can be seen in time."""
        ...


class Gripper(Protocol):
    """A driver of a gripper."""

    @property
    def max_opening(self) -> float:
        """Largest distance between the pads, metres."""
        ...

    def move(self, opening: float, force: float, timeout_s: float) -> float:
        """Goes to an opening, metres, until something resists with `force`, newton, and goes on pressing.

        Returns the opening where it stands. Raises `GripperFault`, `MotionTimeout` or `ConnectionLost`.
        """
        ...

    def opening(self) -> float:
        """The distance between the pads, metres."""
        ...

    def holds(self) -> bool:
        """Whether something is between the pads. A gripper without touch tells it from the opening."""
        ...
