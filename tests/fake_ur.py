"""A controller that is none: what a UR arm says on its dashboard, script and RTDE ports, for tests alone.

`python fake_ur.py ADDRESS` serves the published protocols on a loopback address. It prints "ready", then
takes faults from its standard input, one word a line: `protective`, `emergency`, `silent` (it sends nothing
more), `push` (something presses with 120 N), `drop` (it closes all connections), `led` with six joints (a
person moves it), `quit`. What it was told to do is printed: `servo` with six joints, and `stop`. Nothing of
physics is in it: joints are at once where they are sent.
"""

from __future__ import annotations

import socket
import socketserver
import struct
import sys
import threading
import time

READY, DONE = 1, 2
"""What the uploaded program says in output_int_register_0."""
STOP_PROGRAM = 255
SERVO_J = 11
"""The command for one target of a stream."""
PERIOD = 0.008
SCALARS = {"DOUBLE": "d", "UINT8": "B", "UINT32": "I", "UINT64": "Q", "INT32": "i", "BOOL": "?"}
WIDTHS = {"VECTOR3D": "3d", "VECTOR6D": "6d", "VECTOR6INT32": "6i", "VECTOR6UINT32": "6I"}
KINDS = {
    "robot_mode": "INT32",
    "safety_mode": "INT32",
    "joint_mode": "VECTOR6INT32",
    "runtime_state": "UINT32",
    "robot_status_bits": "UINT32",
    "safety_status_bits": "UINT32",
    "actual_digital_output_bits": "UINT64",
    "actual_digital_input_bits": "UINT64",
    "actual_tool_accelerometer": "VECTOR3D",
    "payload_cog": "VECTOR3D",
    "elbow_position": "VECTOR3D",
    "speed_slider_mask": "UINT32",
}
SIX = ("_q", "_qd", "_qdd", "_current", "_moment", "_voltage", "_temperatures", "_pose", "_speed", "_force")
SIX += ("_output", "_torque", "_wrench", "_inertia", "tcp_offset")


def kind_of(name: str) -> str:
    """The type of a variable, as the guide to RTDE lists it."""
    if name in KINDS:
        return KINDS[name]
    if "int_register" in name:
        return "INT32"
    if "bit_register" in name:
        return "BOOL"
    if "digital_output" in name or name.endswith(("_mask", "_type")):
        return "UINT8"
    if name in ("actual_main_voltage", "actual_robot_voltage", "actual_robot_current"):
        return "DOUBLE"
    return "VECTOR6D" if name.endswith(SIX) else "DOUBLE"


def width(kind: str) -> int:
    """How many numbers a variable has."""
    return int(kind[6]) if kind.startswith("VECTOR") else 1


def packing(kinds: list[str]) -> str:
    return ">" + "".join({**SCALARS, **WIDTHS}[kind] for kind in kinds)


class Controller:
    """The state that all connections share."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.joints = [2.268928, -1.919862, 1.919862, -1.570796, -1.570796, 0.0]
        self.integers = dict.fromkeys(range(48), 0)
        self.numbers = dict.fromkeys(range(48), 0.0)
        self.status, self.robot_mode, self.safety_mode = 1, 7, 1
        self.silent = False
        self.force = [0.0] * 6
        self.answer = 0
        self.began = time.monotonic()
        self.connections: list[socket.socket] = []

    def value(self, name: str, kind: str) -> tuple[float, ...]:
        """What a variable is now."""
        count = width(kind)
        known = {
            "actual_q": self.joints,
            "target_q": self.joints,
            "actual_TCP_force": self.force,
            "timestamp": [time.monotonic() - self.began],
            "robot_mode": [self.robot_mode],
            "safety_mode": [self.safety_mode],
            "safety_status_bits": [{1: 1, 3: 4, 7: 128}[self.safety_mode]],
            "runtime_state": [2 if self.status & 2 else 1],
            "robot_status_bits": [self.status],
            "output_int_register_0": [self.answer],
            "speed_scaling": [1.0],
            "target_speed_fraction": [1.0],
        }
        return tuple(known.get(name, [0] * count))

    def uploaded(self) -> None:
        """A program has arrived on the script port."""
        with self.lock:
            if self.safety_mode == 1:
                self.status, self.answer = 3, READY

    def told(self, inputs: dict[str, tuple[float, ...]]) -> None:
        """Registers were written."""
        with self.lock:
            for name, value in inputs.items():
                if name.startswith("input_int_register_"):
                    self.integers[int(name.rsplit("_", 1)[1])] = int(value[0])
                if name.startswith("input_double_register_"):
                    self.numbers[int(name.rsplit("_", 1)[1])] = value[0]
            if "input_int_register_0" in inputs:
                self._command(int(inputs["input_int_register_0"][0]), inputs)

    def _command(self, number: int, inputs: dict[str, tuple[float, ...]]) -> None:
        if number == 0:
            self.answer = READY if self.status & 2 else 0
        elif number == STOP_PROGRAM:
            self.status &= ~2
            self.answer = 0
        elif self.status & 2:
            doubles = [self.numbers[i] for i in range(6)]
            if "input_double_register_5" in inputs:
                self.joints = doubles
                print("servo", number, *(f"{x:.6f}" for x in doubles), flush=True)
            else:
                print("stop", number, flush=True)
            # A stream of targets is never done; the next one may come.
            self.answer = READY if number == SERVO_J else DONE

    def fault(self, word: str) -> None:
        """What a test does to it."""
        with self.lock:
            if word == "protective":
                self.safety_mode, self.status = 3, 1
            elif word == "emergency":
                self.safety_mode, self.status, self.robot_mode = 7, 1, 3
            elif word == "push":
                self.force = [0.0, 0.0, -120.0, 0.0, 0.0, 0.0]
            elif word == "silent":
                self.silent = True
            elif word == "drop":
                for connection in self.connections:
                    connection.close()
            elif word.startswith("led"):
                self.joints = [float(x) for x in word.split()[1:]]


controller = Controller()


class Dashboard(socketserver.StreamRequestHandler):
    """Port 29999."""

    def handle(self) -> None:
        self.wfile.write(b"Connected: Universal Robots Dashboard Server\n")
        answers = {
            "polyscopeversion": "URSoftware 5.12.4.1101661 (Jun 22 2022)",
            "get serial number": "20225500001",
            "robotmode": "Robotmode: RUNNING",
            "safetystatus": "Safetystatus: NORMAL",
            "running": "Program running: false",
            "is in remote control": "true",
            "get robot model": "UR5",
            "stop": "Stopped",
        }
        for line in self.rfile:
            said = answers.get(line.decode().strip().lower(), "ok")
            self.wfile.write(said.encode() + b"\n")


class Script(socketserver.StreamRequestHandler):
    """Port 30003."""

    def handle(self) -> None:
        self.request.settimeout(0.5)
        received = b""
        while True:
            try:
                part = self.request.recv(1 << 16)
            except TimeoutError:
                part = None
            if part == b"":
                break
            received += part or b""
            if received and (part is None or received.rstrip().endswith(b"end")):
                controller.uploaded()
                received = b""


class Rtde(socketserver.BaseRequestHandler):
    """Port 30004."""

    def handle(self) -> None:
        controller.connections.append(self.request)
        self.inputs: dict[int, list[str]] = {}
        self.outputs: list[str] = []
        self.sends = threading.Event()
        self.writing = threading.Lock()
        threading.Thread(target=self._stream, daemon=True).start()
        try:
            while True:
                size, kind = struct.unpack(">HB", self._exactly(3))
                self._answer(chr(kind), self._exactly(size - 3))
        except (OSError, ConnectionError):
            self.sends.clear()

    def _exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            part = self.request.recv(count - len(data))
            if not part:
                raise ConnectionError
            data += part
        return data

    def _send(self, kind: str, payload: bytes) -> None:
        with self.writing:
            self.request.sendall(struct.pack(">HB", 3 + len(payload), ord(kind)) + payload)

    def _answer(self, kind: str, payload: bytes) -> None:
        if kind == "V":
            self._send("V", b"\x01")
        elif kind == "v":
            self._send("v", struct.pack(">4I", 5, 12, 4, 1101661))
        elif kind == "O":
            self.outputs = [name for name in payload[8:].decode().split(",") if name]
            self._send("O", b"\x01" + ",".join(map(kind_of, self.outputs)).encode())
        elif kind == "I":
            names = [name for name in payload.decode().split(",") if name]
            number = len(self.inputs) + 1
            self.inputs[number] = names
            self._send("I", bytes([number]) + ",".join(map(kind_of, names)).encode())
        elif kind in "SP":
            self._send(kind, b"\x01")
            (self.sends.set if kind == "S" else self.sends.clear)()
        elif kind == "U":
            self._told(payload)

    def _told(self, payload: bytes) -> None:
        names = self.inputs[payload[0]]
        kinds = [kind_of(name) for name in names]
        flat = iter(struct.unpack(packing(kinds), payload[1:]))
        inputs = {
            name: tuple(next(flat) for _ in range(width(kind)))
            for name, kind in zip(names, kinds, strict=True)
        }
        controller.told(inputs)

    def _stream(self) -> None:
        while True:
            self.sends.wait()
            time.sleep(PERIOD)
            if controller.silent:
                continue
            kinds = [kind_of(name) for name in self.outputs]
            with controller.lock:
                values = [controller.value(n, k) for n, k in zip(self.outputs, kinds, strict=True)]
            flat = [x for value in values for x in value]
            try:
                self._send("U", b"\x01" + struct.pack(packing(kinds), *flat))
            except OSError:
                return


class Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = True


def main(address: str) -> None:
    for port, handler in ((29999, Dashboard), (30003, Script), (30004, Rtde)):
        server = Server((address, port), handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
    print("ready", flush=True)
    for line in sys.stdin:
        if line.strip() == "quit":
            return
        controller.fault(line.strip())


if __name__ == "__main__":
    main(sys.argv[1])
