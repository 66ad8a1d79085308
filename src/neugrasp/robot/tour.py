"""A camera on the wrist, driven from view to view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from neugrasp.geometry.camera import Camera
from neugrasp.robot.errors import CameraFault
from neugrasp.robot.interface import Arm
from neugrasp.robot.interface import Camera as Eyes
from neugrasp.robot.trajectory import Trajectory

Seen = TypeVar("Seen", covariant=True)

ARRIVED = 0.003
"""Radians by which the joints may be away from a view: two millimetres at the camera."""
TIMEOUT_S = 5.0
"""Beyond the length of a motion."""


@dataclass(frozen=True)
class Stop:
    """One view: where the camera is to be, and the way there."""

    camera: Camera
    """In the user's world."""
    way: Trajectory
    """From the stop before, or from out of sight."""


@dataclass(frozen=True)
class Tour:
    """All views, one after the other, and back."""

    stops: tuple[Stop, ...]
    home: Trajectory
    """From the last one out of sight."""


@dataclass(frozen=True)
class TouringCamera(Generic[Seen]):
    """Drives through all views before it looks: what a simulated camera sees does not hang on the arm, but
    the arm has to get there."""

    arm: Arm
    tour: Tour
    camera: Eyes[Seen]

    def capture(self) -> Seen:
        """What the camera sees. Raises a `RobotError` where the arm does not arrive at a view."""
        for number, stop in enumerate(self.tour.stops):
            self.arm.execute(stop.way, False, stop.way.duration + TIMEOUT_S)
            away = float(np.abs(self.arm.state().joints - stop.way.joints[-1]).max())
            if away > ARRIVED:
                raise CameraFault(f"view {number}: the arm stands {away:.4f} rad away from it")
        self.arm.execute(self.tour.home, False, self.tour.home.duration + TIMEOUT_S)
        return self.camera.capture()
