"""The layer below the network: what an arm may be told to do, whatever was predicted or planned.

Everything that moves an arm goes through `Guarded`. It looks at the whole motion before the first part of it
is passed on, and after a fault or a stop it passes nothing on.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from neugrasp.geometry.pose import Array, apply, inverse
from neugrasp.robot.arm_model import ArmModel
from neugrasp.robot.errors import (
    KeptOut,
    LimitExceeded,
    NotFinite,
    OutsideZone,
    Refused,
    RobotError,
    Stopped,
    TooFast,
    TooLow,
)
from neugrasp.robot.interface import Arm, ArmState, Guidable, StopsOnLeaving
from neugrasp.robot.trajectory import Pace, Trajectory

START_TOLERANCE = 0.02
"""Radians by which the arm may be away from where a motion starts."""
ROUNDING = 1.02
"""Factor for speeds and accelerations taken from differences of samples."""
BESIDE = 0.25
"""Parts of a link between points that are looked at."""


@dataclass(frozen=True)
class Box:
    """A box along the axes of the world."""

    low: Array
    """(3,) metres."""
    high: Array
    """(3,) metres."""

    def holds(self, points: Array) -> Array:
        """Whether points (..., 3) lie inside."""
        inside: Array = np.all((points >= self.low) & (points <= self.high), axis=-1)
        return inside

    def moved(self, shift: Array) -> Box:
        """The same box elsewhere; `shift` (3,) in metres."""
        return Box(self.low + shift, self.high + shift)


@dataclass(frozen=True)
class Limits:
    """What a cell file allows."""

    pace: Pace
    zone: Box
    """Where the TCP may be, world frame."""
    lowest_tcp: float
    """Metres that the TCP keeps above the table."""
    keep_out: tuple[Box, ...] = ()
    """Where no part of the arm and no finger may be, world frame."""
    force: float = 100.0
    """Newton by which the force at the TCP may change in a motion; the driver ends it there."""


@dataclass(frozen=True)
class Fence:
    """The limits with the geometry that they are about. Poses and motions are refused with an error each."""

    limits: Limits
    model: ArmModel
    world_from_base: Array
    flange_from_tcp: Array
    world_from_table: Array
    """Its x and y axes lie in the table's surface, z points away from it."""

    def check_pose(self, world_from_tcp: Array) -> None:
        """Raises `NotFinite`, `TooLow`, `OutsideZone` or `KeptOut` where the TCP must not be there."""
        if not np.all(np.isfinite(world_from_tcp)):
            raise NotFinite("a pose holds NaN or infinity; nothing has moved")
        self._check_tcp(np.asarray(world_from_tcp)[None, :3, 3])

    def allows(self, joints: Array) -> bool:
        """Whether the joints may be at (6,): TCP and links where the limits let them. For planners."""
        try:
            self._check_places(joints[None])
        except Refused:
            return False
        return True

    def check(self, motion: Trajectory, now: Array) -> None:
        """Raises a `Refused` where any moment of a motion from the joints `now` (6,) is not allowed."""
        times, joints = motion.times, motion.joints
        if not (np.all(np.isfinite(times)) and np.all(np.isfinite(joints)) and np.all(np.isfinite(now))):
            raise NotFinite("a motion holds NaN or infinity; nothing has moved")
        if np.any(np.diff(times) <= 0):
            raise TooFast("a motion's times do not increase; nothing has moved")
        away = float(np.abs(joints[0] - now).max())
        if away > START_TOLERANCE:
            raise LimitExceeded(f"the motion starts {away:.3f} rad from where the arm is; plan it again")
        beyond = np.maximum(joints - np.array(self.model.high), np.array(self.model.low) - joints)
        if beyond.max() > 1e-9:
            joint = int(beyond.max(axis=0).argmax()) + 1
            raise LimitExceeded(f"joint {joint} would leave its range by {beyond.max():.3f} rad")
        self._check_pace(times, joints, self._check_places(joints))

    def _check_places(self, joints: Array) -> Array:
        """Where the TCP is (n, 3). Raises a `Refused` where it, or a link, must not be."""
        frames = self.world_from_base @ self.model.frames(joints)
        tcp: Array = (frames[:, -1] @ self.flange_from_tcp)[:, :3, 3]
        self._check_tcp(tcp)
        self._check_links(frames[:, :, :3, 3], tcp)
        return tcp

    def _check_pace(self, times: Array, joints: Array, tcp: Array) -> None:
        steps = np.diff(times)
        turning = np.diff(joints, axis=0) / steps[:, None]
        if (most := float(np.abs(turning).max())) > ROUNDING * self.limits.pace.joint_speed:
            raise TooFast(f"a joint would turn at {most:.2f} rad/s; {self.limits.pace.joint_speed:g} allowed")
        speed = float((np.linalg.norm(np.diff(tcp, axis=0), axis=1) / steps).max())
        if speed > ROUNDING * self.limits.pace.tcp_speed:
            raise TooFast(f"the TCP would move at {speed:.2f} m/s; {self.limits.pace.tcp_speed:g} allowed")
        # A motion starts and ends at rest.
        rates = np.vstack([np.zeros((1, joints.shape[1])), turning, np.zeros((1, joints.shape[1]))])
        between = np.concatenate([steps[:1], (steps[1:] + steps[:-1]) / 2, steps[-1:]])
        most = float(np.abs(np.diff(rates, axis=0) / between[:, None]).max())
        if most > ROUNDING * self.limits.pace.joint_acceleration:
            allowed = self.limits.pace.joint_acceleration
            raise TooFast(f"a joint would accelerate at {most:.2f} rad/s^2; {allowed:g} allowed")

    def _check_tcp(self, points: Array) -> None:
        heights = apply(inverse(self.world_from_table), points)[:, 2]
        if (lowest := float(heights.min())) < self.limits.lowest_tcp - 1e-9:
            raise TooLow(
                f"the TCP would be {1000 * lowest:.0f} mm above the table; "
                f"at least {1000 * self.limits.lowest_tcp:.0f} mm are allowed"
            )
        outside = ~self.limits.zone.holds(points).astype(bool)
        if outside.any():
            x, y, z = points[outside.argmax()].tolist()
            raise OutsideZone(f"the TCP would be at ({x:.3f}, {y:.3f}, {z:.3f}) m, outside its zone")
        self._check_boxes(points)

    def _check_links(self, origins: Array, tcp: Array) -> None:
        """`origins` (n, 7, 3) of the links' frames; points between them stand for the links."""
        if not self.limits.keep_out:
            return
        chain = np.concatenate([origins, tcp[:, None]], axis=1)
        for part in np.arange(0, 1, BESIDE):
            self._check_boxes((1 - part) * chain[:, 1:-1] + part * chain[:, 2:])

    def _check_boxes(self, points: Array) -> None:
        for number, box in enumerate(self.limits.keep_out):
            if box.holds(points).any():
                raise KeptOut(f"a part of the arm would be in keep-out box {number}")


class Guarded(StopsOnLeaving):
    """An arm that does only what its fence allows. Leaving its context stops it."""

    def __init__(self, arm: Arm, fence: Fence):
        self._arm = arm
        self.fence = fence
        self._stopped = threading.Event()
        self._fault: RobotError | None = None

    def state(self) -> ArmState:
        """Where the arm is. A fault that shows here is one, too: nothing moves afterwards."""
        try:
            return self._arm.state()
        except RobotError as fault:
            self._fault = fault
            raise

    @contextmanager
    def led_by_hand(self) -> Iterator[None]:
        """A person moves the arm as long as this lasts, wherever that is. Raises a `RobotError` where the arm
        cannot be led, or must not move any more."""
        self._check_moving()
        if not isinstance(self._arm, Guidable):
            raise RobotError("this arm cannot be led by hand")
        self._arm.release()
        try:
            yield
        finally:
            self._arm.hold()

    def _check_moving(self) -> None:
        if self._fault is not None:
            raise self._fault
        if self._stopped.is_set():
            raise Stopped("the arm was stopped; nothing moves until the program is started again")

    def execute(self, motion: Trajectory, until_contact: bool, timeout_s: float) -> bool:
        """As `Arm.execute`. Raises a `Refused` before anything moves; after a fault, the same fault again."""
        self._check_moving()
        self.fence.check(motion, self.state().joints)
        try:
            return self._arm.execute(motion, until_contact, timeout_s)
        except RobotError as fault:
            self._fault = fault
            self._arm.stop()
            raise

    def stop(self) -> None:
        """Stops the arm, from whichever thread; nothing moves afterwards."""
        self._stopped.set()
        self._arm.stop()
