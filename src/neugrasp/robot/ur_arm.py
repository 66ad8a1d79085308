"""A UR arm, driven by a process of its own: whatever happens to that, the cause has a name here."""

from __future__ import annotations

import contextlib
import multiprocessing
import threading
from types import TracebackType
from typing import Any

import numpy as np

from neugrasp.robot import errors
from neugrasp.robot.errors import ConnectionLost, RobotError
from neugrasp.robot.interface import ArmState
from neugrasp.robot.trajectory import Trajectory
from neugrasp.robot.ur_controller import ALIVE, serve

CONNECTING_S = 30.0
"""Seconds that a controller is given to take commands."""
SILENCE_S = 2.0
"""Seconds after which a process that says nothing is given up: the library waits for a lost connection."""
CLOSING_S = 5.0


class UrArm:
    """The arm at an address. Use as a context: leaving it stops the arm and the program on the controller."""

    def __init__(self, address: str, force_limit: float):
        """`force_limit` is the change of the force at the TCP, newton, that ends a motion.

        Raises `ConnectionLost` where there is no controller that takes commands, and `RobotError` without
        ur_rtde.
        """
        self._address = address
        context = multiprocessing.get_context("spawn")
        self._asking, theirs = context.Pipe()
        self._stops, listening = context.Pipe()
        self._process = context.Process(
            target=serve, args=(address, force_limit, theirs, listening), daemon=True
        )
        self._process.start()
        theirs.close()
        listening.close()
        self._lock = threading.Lock()
        try:
            self._answer(CONNECTING_S)
        except RobotError:
            self._close()
            raise

    def __enter__(self) -> UrArm:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()
        self._close()

    def _close(self) -> None:
        """The process ends when nobody asks any more."""
        with self._lock:
            self._asking.close()
            self._stops.close()
        self._process.join(CLOSING_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process.close()

    def state(self) -> ArmState:
        """Where the joints are. Raises the fault that the controller has."""
        joints, speeds, stamp = self._ask("state")
        return ArmState(np.array(joints), np.array(speeds), stamp)

    def execute(self, motion: Trajectory, until_contact: bool, timeout_s: float) -> bool:
        """As `Arm.execute`."""
        sent = (motion.times.tolist(), motion.joints.tolist(), until_contact, timeout_s)
        return bool(self._ask("execute", *sent))

    def release(self) -> None:
        """As `Guidable.release`: the controller's free drive."""
        self._ask("release")

    def hold(self) -> None:
        """As `Guidable.hold`."""
        self._ask("hold")

    def stop(self) -> None:
        """Ends a motion at its next target, in eight milliseconds; nothing moves afterwards."""
        with contextlib.suppress(OSError):
            self._stops.send("stop")

    def _ask(self, *words: Any) -> Any:
        with self._lock:
            try:
                self._asking.send(words)
            except OSError as error:
                raise ConnectionLost(f"{self._address}: the driver of the arm has ended") from error
            return self._answer(SILENCE_S)

    def _answer(self, silence_s: float) -> Any:
        """What the process says. Raises the `RobotError` that it names; an execution that lasts too long ends
        there by itself."""
        said, content = ALIVE, None
        try:
            while said == ALIVE:
                if not self._asking.poll(silence_s):
                    self._process.kill()
                    raise ConnectionLost(f"{self._address}: the driver of the arm does not answer")
                said, content = self._asking.recv()
        except (EOFError, OSError) as error:
            raise ConnectionLost(f"{self._address}: the driver of the arm has ended") from error
        if said == "done":
            return content
        kind = getattr(errors, said, RobotError)
        raise kind(content)
