"""A UR arm on the network, in a process of its own: the only file that imports ur_rtde.

The library holds the interpreter while it connects, and may crash while a connection is lost; whoever drives
the arm (`robot.ur_arm`) must outlive both. A motion is streamed at 125 Hz as targets of the joints
(`servoJ`), so that the arm does exactly what was planned and looked at. At every target the driver looks
at the controller: a force beyond the cell file's, a protective or emergency stop, old news or a lost
connection end the motion, and the arm stands still by the controller's own doing.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from neugrasp.errors import NeuGraspError, require
from neugrasp.geometry.pose import Array
from neugrasp.robot.errors import (
    ConnectionLost,
    EmergencyStop,
    ForceLimit,
    MotionTimeout,
    ProtectiveStop,
    RobotError,
    Stopped,
)
from neugrasp.robot.interface import ArmState
from neugrasp.robot.trajectory import PERIOD, Trajectory

LOOKAHEAD_S, GAIN = 0.1, 300.0
"""Parameters of `servoJ`: the controller's usual ones."""
NEWS_S = 0.1
"""Seconds within which the two connections of the library have the same news."""
STALE_S = 0.2
"""Seconds after which the controller should have said something."""
ALIVE, ALIVE_S = "alive", 0.25
"""What is said while a motion lasts, and after how many seconds."""
CONTACT_N = 15.0
"""Newton by which the force at the TCP changes when something is touched."""
BRAKING = 2.0
"""rad/s^2 with which a motion is ended."""
ARRIVED, STILL, RESTING = 0.002, 0.0002, 5
"""A motion is over when the joints are so near to its end, radians, and move by less, in five looks."""
SETTLING_S = 3.0
"""Seconds that the arm is given for it."""


class Controller:
    """The controller at an address."""

    def __init__(self, address: str, force_limit: float):
        """`force_limit` is the change of the force at the TCP, newton, at which a motion is ended.

        Raises `MissingExtra`, or `ConnectionLost` where there is no controller that takes commands.
        """
        rtde_receive, rtde_control = (
            require(name, extra="robot") for name in ("rtde_receive", "rtde_control")
        )
        try:
            self._receive: Any = rtde_receive.RTDEReceiveInterface(address)
            self._control: Any = rtde_control.RTDEControlInterface(address)
        except RuntimeError as error:
            raise ConnectionLost(
                f"{address}: no UR controller that takes commands ({error}); is it on, released "
                "and in remote control?"
            ) from error
        self._address, self._force_limit = address, force_limit
        self._last, self._seen = -1.0, time.monotonic()

    def close(self) -> None:
        """Stops the arm, and the program on the controller."""
        self._control.servoStop(BRAKING)
        self._control.stopScript()
        self._control.disconnect()
        self._receive.disconnect()

    def state(self) -> ArmState:
        """Where the joints are. Raises the fault that the controller has."""
        self._check()
        joints = np.array(self._receive.getActualQ(), dtype=np.float64)
        speeds = np.array(self._receive.getActualQd(), dtype=np.float64)
        if joints.shape != (6,) or speeds.shape != (6,):
            raise ConnectionLost(f"{self._address}: the controller sends no joints")
        return ArmState(joints, speeds, self._seen)

    def lead(self, begins: bool) -> None:
        """Begins or ends free drive. Raises the fault that the controller has."""
        self._check()
        if not (self._control.teachMode() if begins else self._control.endTeachMode()):
            self._check()
            raise RobotError(f"{self._address}: the controller refuses free drive")

    def execute(
        self, motion: Trajectory, until_contact: bool, timeout_s: float, is_stopped: Callable[[], bool]
    ) -> bool:
        """As `Arm.execute`; `is_stopped` is asked before every target."""
        self._hear()
        began, force = time.monotonic(), self._force()
        deadline = began + timeout_s
        try:
            for target, moment in self._targets(motion):
                self._wait_until(began + moment)
                self._send(target, deadline, is_stopped)
                change = float(np.linalg.norm(self._force() - force))
                if change > self._force_limit:
                    raise ForceLimit(
                        f"{self._address}: the force at the TCP changed by {change:.0f} N; "
                        f"{self._force_limit:g} N allowed"
                    )
                if until_contact and change > CONTACT_N:
                    return True
            self._arrive(motion.joints[-1], deadline, is_stopped)
            return False
        finally:
            self._control.servoStop(BRAKING)

    def _targets(self, motion: Trajectory) -> list[tuple[Array, float]]:
        moments = np.arange(1, int(np.ceil(motion.duration / PERIOD)) + 1) * PERIOD
        return [(motion.at(float(moment)), float(moment)) for moment in moments]

    def _wait_until(self, moment: float) -> None:
        time.sleep(max(0.0, moment - time.monotonic()))

    def _send(self, target: Array, deadline: float, is_stopped: Callable[[], bool]) -> None:
        if is_stopped():
            raise Stopped("the arm was stopped on its way")
        if time.monotonic() > deadline:
            raise MotionTimeout("the motion takes longer than it may")
        self._check()
        if not self._control.servoJ(target.tolist(), 0.0, 0.0, PERIOD, LOOKAHEAD_S, GAIN):
            self._check()
            raise RobotError(f"{self._address}: the controller refuses a target")

    def _arrive(self, goal: Array, deadline: float, is_stopped: Callable[[], bool]) -> None:
        """Goes on sending the end until the arm, which follows a tenth of a second late, rests there."""
        deadline = min(deadline, time.monotonic() + SETTLING_S)
        rested = 0
        before = self.state().joints
        while rested < RESTING:
            self._wait_until(time.monotonic() + PERIOD)
            self._send(goal, deadline, is_stopped)
            now = self.state().joints
            is_there = np.abs(now - goal).max() < ARRIVED and np.abs(now - before).max() < STILL
            rested = rested + 1 if is_there else 0
            before = now

    def _hear(self) -> None:
        """Waits for news of after this moment: before anything moves, the controller must be there."""
        stamp, deadline = self._receive.getTimestamp(), time.monotonic() + STALE_S
        while self._receive.getTimestamp() == stamp:
            if time.monotonic() > deadline:
                raise ConnectionLost(f"{self._address}: the controller has said nothing for {STALE_S} s")
            time.sleep(PERIOD / 4)

    def _force(self) -> Array:
        return np.array(self._receive.getActualTCPForce()[:3], dtype=np.float64)

    def _check(self) -> None:
        """Raises what is wrong with the controller."""
        now, stamp = time.monotonic(), float(self._receive.getTimestamp())
        if stamp != self._last:
            self._last, self._seen = stamp, now
        if not self._receive.isConnected():
            raise ConnectionLost(f"{self._address}: the connection to the controller is lost")
        if now - self._seen > STALE_S:
            raise ConnectionLost(
                f"{self._address}: the controller has said nothing for {now - self._seen:.1f} s"
            )
        if not self._control.isProgramRunning():
            # Its reason may come with the next news only; where none come, the connection is the reason.
            time.sleep(NEWS_S)
            self._hear()
        if self._receive.isEmergencyStopped():
            raise EmergencyStop(f"{self._address}: emergency stop; release it and look before going on")
        if self._receive.isProtectiveStopped():
            raise ProtectiveStop(f"{self._address}: protective stop; unlock it on the pendant after a look")
        if not self._control.isProgramRunning():
            raise RobotError(f"{self._address}: the program on the controller has ended")


def serve(address: str, force_limit: float, asked: Connection, stops: Connection) -> None:
    """The life of the process: does what comes in, one after the other, and answers; ends with its parent."""
    try:
        controller = Controller(address, force_limit)
    except NeuGraspError as error:
        asked.send((type(error).__name__, str(error)))
        return
    asked.send(("done", None))

    told = [time.monotonic()]

    def is_stopped() -> bool:
        """Asked at every target; says now and then that the process is alive."""
        if time.monotonic() - told[0] > ALIVE_S:
            told[0] = time.monotonic()
            asked.send((ALIVE, None))
        return stops.poll()

    while True:
        try:
            what, *arguments = asked.recv()
        except EOFError:
            controller.close()
            return
        try:
            if what == "state":
                state = controller.state()
                asked.send(("done", (state.joints.tolist(), state.speeds.tolist(), state.stamp)))
            elif what in ("release", "hold"):
                controller.lead(what == "release")
                asked.send(("done", None))
            else:
                times, joints, until_contact, timeout_s = arguments
                motion = Trajectory(np.array(times), np.array(joints))
                asked.send(("done", controller.execute(motion, until_contact, timeout_s, is_stopped)))
        except RobotError as error:
            asked.send((type(error).__name__, str(error)))
