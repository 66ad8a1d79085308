"""A controller and a gripper that are none, for tests: see fake_ur.py for what is behind the first."""

from __future__ import annotations

import queue
import socketserver
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

FAKE = Path(__file__).parent / "fake_ur.py"
numbers = count(10)


class FakeUr:
    """The process of the controller, and what it says."""

    def __init__(self) -> None:
        self.address = f"127.0.1.{next(numbers)}"
        self.process = subprocess.Popen(
            [sys.executable, str(FAKE), self.address],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        self.lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()
        assert self.lines.get(timeout=20) == "ready"

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.put(line.strip())

    def fault(self, word: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(word + "\n")
        self.process.stdin.flush()

    def said(self) -> list[str]:
        lines = []
        while not self.lines.empty():
            lines.append(self.lines.get())
        return lines

    def close(self) -> None:
        self.process.kill()
        with self.process:
            pass


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


@contextmanager
def serving(fingers: Fingers, address: str, port: int) -> Iterator[int]:
    """The gripper's socket, and its port."""

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            for line in self.rfile:
                if fingers.hangs_up:
                    return
                self.wfile.write(fingers.answer(line.decode().strip()))

    class Server(socketserver.ThreadingTCPServer):
        allow_reuse_address = True
        daemon_threads = True

    with Server((address, port), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server.server_address[1]
        server.shutdown()
