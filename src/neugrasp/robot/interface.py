"""What a robot cell can do, simulated or real: look, move, close, deliver. The benchmark knows nothing else.

Poses and positions are those of the TCP in the user's world, metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from neugrasp.geometry.pose import Array

Seen = TypeVar("Seen", covariant=True)


class Camera(Protocol[Seen]):
    """The cameras of a cell, or one camera on the wrist that is driven around."""

    def look(self) -> Seen:
        """What lies on the table now: `Views` from a camera for photos, `DepthViews` from one for depth."""
        ...


class Arm(Protocol):
    """What moves the hand."""

    def go_to(self, world_from_tcp: Array) -> bool:
        """Brings the hand to a pose on a way of its own; False where it cannot without touching something."""
        ...

    def move_straight(self, position: Array, stop_on_contact: bool) -> bool:
        """Leads the TCP along a line, its orientation kept; whether a contact stopped it on the way."""
        ...

    def deliver(self) -> None:
        """Takes what is held off the table and the hand out of sight; returns when all that is left rests."""
        ...

    def leave(self) -> None:
        """Lets go and takes the hand out of sight; returns when everything rests."""
        ...


class Gripper(Protocol):
    """What closes around an object."""

    @property
    def max_opening(self) -> float:
        """Largest distance between the pads, metres."""
        ...

    def open(self) -> None:
        """Opens as far as it goes."""
        ...

    def close(self) -> None:
        """Closes until something or the other finger resists, and goes on pressing."""
        ...

    def opening(self) -> float:
        """The distance between the pads, metres."""
        ...

    def holds(self) -> bool:
        """Whether an object touches the hand. A gripper without touch tells it from the opening."""
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
    arm: Arm
    gripper: Gripper
    table: Table
