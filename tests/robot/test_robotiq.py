"""The gripper's driver against a socket of ours that speaks its published lines, with faults."""

from __future__ import annotations

import socketserver
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest

from neugrasp.robot import robotiq
from neugrasp.robot.errors import ConnectionLost, GripperFault, MotionTimeout
from neugrasp.robot.robotiq import Robotiq


@dataclass
class Fingers:
    """What the gripper would do: it needs some questions to arrive, and stops at what is between."""

    thing: int | None = None
    """The position at which something is between the pads."""
    values: dict[str, int] = field(default_factory=lambda: {"STA": 3, "ACT": 1, "POS": 3, "FLT": 0, "OBJ": 3})
    echo_after: int = 3
    """Questions until PRE is the new request."""
    never_arrives: bool = False
    hangs_up: bool = False
    lies: bool = False
    asked: list[str] = field(default_factory=list)

    def answer(self, line: str) -> bytes:
        self.asked.append(line)
        words = line.split()
        if self.lies:
            return b"?\n"
        if words[0] == "SET":
            pairs = dict(zip(words[1::2], map(int, words[2::2]), strict=True))
            self.values |= pairs
            if "POS" in pairs:
                self.request, self.values["POS"] = pairs["POS"], self.values.get("AT", 3)
                self.waiting = self.echo_after
            if pairs.get("ACT") == 1:
                self.values["STA"] = 3
            elif pairs.get("ACT") == 0:
                self.values |= {"STA": 0, "FLT": 0}
            return b"ack"
        name = words[1]
        if name == "PRE":
            self.waiting -= 1
            return f"PRE {self.request if self.waiting < 0 else 0}\n".encode()
        if name == "OBJ" and not self.never_arrives and self.waiting < 0:
            stopped = self.thing is not None and self.request > self.thing
            self.values |= {"OBJ": 2 if stopped else 3}
            self.values["POS"] = self.values["AT"] = self.thing if stopped else min(self.request, 228)  # type: ignore[assignment]
        if name == "OBJ" and self.never_arrives:
            return b"OBJ 0\n"
        return f"{name} {self.values.get(name, 0)}\n".encode()

    request: int = 3
    waiting: int = -1


@pytest.fixture
def fingers() -> Iterator[tuple[Fingers, int]]:
    behind = Fingers()

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            for line in self.rfile:
                if behind.hangs_up:
                    return
                self.wfile.write(behind.answer(line.decode().strip()))

    class Server(socketserver.ThreadingTCPServer):
        allow_reuse_address = True
        daemon_threads = True

    with Server(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield behind, server.server_address[1]
        server.shutdown()


def test_it_opens_and_closes_and_knows_how_far(fingers: tuple[Fingers, int]):
    _, port = fingers
    with Robotiq("127.0.0.1", 0.085, port) as gripper:
        assert gripper.move(0.085, 20, 5) == pytest.approx(0.085)
        assert gripper.move(0.0425, 20, 5) == pytest.approx(0.0425, abs=0.0005)
        assert gripper.move(0.0, 20, 5) == 0.0
        assert not gripper.holds()


def test_something_between_the_pads_is_held_and_the_old_answer_is_not_believed(fingers: tuple[Fingers, int]):
    """OBJ is asked only once the echo is that of this request."""
    behind, port = fingers
    behind.thing = 120
    with Robotiq("127.0.0.1", 0.085, port) as gripper:
        gripper.move(0.085, 20, 5)
        behind.asked.clear()
        assert gripper.move(0.0, 20, 5) == pytest.approx(0.085 * 108 / 225, abs=1e-6)
        assert gripper.holds()
        first = behind.asked.index("GET OBJ")
        assert behind.asked[:first].count("GET PRE") > behind.echo_after
        assert "FOR 0" in behind.asked[0]


def test_it_is_activated_where_it_is_not(fingers: tuple[Fingers, int]):
    behind, port = fingers
    behind.values |= {"STA": 0, "FLT": 7}
    Robotiq("127.0.0.1", 0.085, port).close()
    assert [line for line in behind.asked if "ACT" in line] == ["SET ACT 0", "SET ACT 1"]


def test_each_fault_is_what_it_is(fingers: tuple[Fingers, int], monkeypatch: pytest.MonkeyPatch):
    behind, port = fingers
    monkeypatch.setattr(robotiq, "TIMEOUT_S", 0.5)
    with Robotiq("127.0.0.1", 0.085, port) as gripper:
        behind.never_arrives = True
        with pytest.raises(MotionTimeout, match=r"does not arrive in 0\.2 s"):
            gripper.move(0.0, 20, 0.2)
        behind.values["FLT"] = 8
        with pytest.raises(GripperFault, match="fault 8: it is too hot"):
            gripper.move(0.0, 20, 5)
        behind.lies = True
        with pytest.raises(GripperFault, match=r"answers '\?' to GET POS"):
            gripper.opening()
        behind.hangs_up = True
        with pytest.raises(ConnectionLost):
            gripper.opening()


def test_where_there_is_none_that_is_said():
    with pytest.raises(ConnectionLost, match="no gripper answers"):
        Robotiq("127.0.0.1", 0.085, 9)
