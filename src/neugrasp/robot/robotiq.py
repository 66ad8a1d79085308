"""A Robotiq 2F gripper behind the URCap's socket: lines of text on port 63352 of the controller."""

from __future__ import annotations

import socket
import time
from types import TracebackType

from neugrasp.gripper import Gripper as Hand
from neugrasp.robot.errors import ConnectionLost, GripperFault, MotionTimeout, RobotError

PORT = 63352
TIMEOUT_S = 2.0
"""For one answer."""
ACTIVATION_S = 10.0
POLL_S = 0.02
OPEN, CLOSED = 3, 228
"""Positions (0 to 255) at which a 2F-85 with its own pads is open and closed."""
FORCES = (20.0, 235.0)
"""Newton of the least and the most that FOR, 0 to 255, stands for (2F-85)."""
ACTIVE = 3
MOVING, STOPPED_OPENING, STOPPED_CLOSING, ARRIVED = range(4)
"""What OBJ says."""
FAULTS = {
    5: "it must be activated before it moves",
    7: "it was not activated",
    8: "it is too hot",
    9: "it has no communication",
    10: "its supply voltage is too low",
    11: "it is releasing what it held",
    12: "its current is too high",
    13: "its movement is faulty",
    14: "its activation failed",
    15: "its automatic release is complete: activate it again",
}


class Robotiq:
    """The gripper at an address. The position is linear in the angle of the crank where the gripper's file
    knows it, else in the opening."""

    def __init__(self, address: str, gripper: Hand, port: int = PORT):
        """Connects, and activates it where it is not. Raises `ConnectionLost` or `GripperFault`."""
        self._name, self._hand = f"{address}:{port}", gripper
        try:
            self._socket = socket.create_connection((address, port), timeout=TIMEOUT_S)
        except OSError as error:
            raise ConnectionLost(f"{self._name}: no gripper answers ({error})") from error
        try:
            self._activate()
        except RobotError:
            self.close()
            raise

    def __enter__(self) -> Robotiq:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the connection; the fingers stay as they are."""
        self._socket.close()

    @property
    def max_opening(self) -> float:
        """Largest distance between the pads, metres."""
        return self._hand.max_opening

    def move(self, opening: float, force: float, timeout_s: float) -> float:
        """As `Gripper.move`."""
        position = self._position(opening)
        share = (force - FORCES[0]) / (FORCES[1] - FORCES[0])
        self._set(POS=position, SPE=255, FOR=round(255 * min(1.0, max(0.0, share))), GTO=1)
        deadline = time.monotonic() + timeout_s
        # What OBJ says is about the request before until PRE, the echo, is the new one.
        while self._get("PRE") != position or self._get("OBJ") == MOVING:
            self._check_fault()
            if time.monotonic() > deadline:
                raise MotionTimeout(f"{self._name}: the gripper does not arrive in {timeout_s:.1f} s")
            time.sleep(POLL_S)
        self._check_fault()
        return self.opening()

    def opening(self) -> float:
        """The distance between the pads, metres."""
        return _opening_at(self._hand, (CLOSED - self._get("POS")) / (CLOSED - OPEN))

    def holds(self) -> bool:
        """Whether something stopped the fingers while they closed."""
        return self._get("OBJ") == STOPPED_CLOSING

    def _position(self, opening: float) -> int:
        way = CLOSED - _motor_share(self._hand, opening) * (CLOSED - OPEN)
        return round(way) if opening > 0 else 255

    def _activate(self) -> None:
        if self._get("STA") == ACTIVE and self._get("FLT") == 0:
            return
        self._set(ACT=0)
        self._set(ACT=1)
        deadline = time.monotonic() + ACTIVATION_S
        while self._get("STA") != ACTIVE:
            if time.monotonic() > deadline:
                raise GripperFault(f"{self._name}: the gripper is not activated in {ACTIVATION_S:.0f} s")
            time.sleep(POLL_S)

    def _check_fault(self) -> None:
        if (fault := self._get("FLT")) != 0:
            raise GripperFault(f"{self._name}: fault {fault}: {FAULTS.get(fault, 'see its manual')}")

    def _get(self, name: str) -> int:
        words = self._ask(f"GET {name}").split()
        if len(words) != 2 or words[0] != name or not words[1].isdigit():
            raise GripperFault(f"{self._name}: answers {' '.join(words)[:40]!r} to GET {name}")
        return int(words[1])

    def _set(self, **values: int) -> None:
        said = self._ask("SET " + " ".join(f"{name} {value}" for name, value in values.items()))
        if said.strip() != "ack":
            raise GripperFault(f"{self._name}: answers {said[:40]!r} to SET")

    def _ask(self, line: str) -> str:
        """One answer. An acknowledgement has no end of line, so that whatever has arrived is the answer."""
        try:
            self._socket.sendall(line.encode("ascii") + b"\n")
            said = self._socket.recv(1024)
        except OSError as error:
            raise ConnectionLost(f"{self._name}: the gripper does not answer ({error})") from error
        if not said:
            raise ConnectionLost(f"{self._name}: the gripper closed the connection")
        return said.decode("ascii", errors="replace")


def _motor_share(hand: Hand, opening: float) -> float:
    """The motor's way, 0 closed to 1 open, with the pads so far apart."""
    share = min(1.0, max(0.0, opening / hand.max_opening))
    if hand.finger_arc is None:
        return share
    closed, wide = (hand.finger_arc.angle(apart) for apart in (0.0, hand.max_opening))
    return (hand.finger_arc.angle(share * hand.max_opening) - closed) / (wide - closed)


def _opening_at(hand: Hand, motor_share: float) -> float:
    """The reverse of `_motor_share`, metres."""
    share, largest = min(1.0, max(0.0, motor_share)), hand.max_opening
    if hand.finger_arc is None:
        return largest * share
    closed, wide = (hand.finger_arc.angle(apart) for apart in (0.0, largest))
    return min(largest, max(0.0, hand.finger_arc.opening(closed + share * (wide - closed))))
