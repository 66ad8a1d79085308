"""A server that listens until it is told to end: the only file that imports uvicorn."""

from __future__ import annotations

import asyncio
import logging
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import uvicorn

from neugrasp.client import Client
from neugrasp.demo.bundled import demo_scenes
from neugrasp.errors import NeuGraspError
from neugrasp.progress import reached
from neugrasp.server.app import gated
from neugrasp.server.command import Serve
from neugrasp.server.service import Service
from neugrasp.terminal import next_step

log = logging.getLogger(__name__)
CONNECTIONS = 256
"""At once; further ones are answered with 503."""
STEPS = 3
"""Steps of a check: loading, listening, answering."""
START_S = 60.0
"""Seconds that it may take to listen."""


def listen(config: Serve, port: int, token: str | None) -> str:
    """Serves until SIGINT or SIGTERM; then what was begun is finished, and nothing new is taken.

    Raises `KeyboardInterrupt` at the end where it was SIGINT.
    """
    service = Service(config)
    server = Server(service, port, token)
    server.serve_until_told()
    if server.told == signal.SIGINT:
        raise KeyboardInterrupt
    return f"drained: {service.answered} detections since the start"


def check(config: Serve, token: str | None) -> str:
    """Loads, listens, answers a bundled scene once and ends: how long the answer took."""
    reached("steps", 0, STEPS)
    service = Service(config)
    reached("steps", 1, STEPS)
    server = Server(service, 0, token, host="127.0.0.1")
    thread = threading.Thread(target=server.serve_until_told)
    thread.start()
    try:
        server.wait()
        reached("steps", 2, STEPS)
        begun = time.perf_counter()
        with Client(f"http://127.0.0.1:{server.port}", token=token, timeout_s=config.patience_s) as client:
            answer = client.ask(demo_scenes()[0].folder)
        took = time.perf_counter() - begun
    finally:
        server.should_exit = True
        thread.join()
    reached("steps", STEPS, STEPS)
    count, again = len(answer.detection.grasps), next_step("serve", why="until Ctrl-C")
    return (
        f"answered a bundled scene with {count} grasps in {took:.2f} s, the doctor: {answer.verdict}\n{again}"
    )


class Server(uvicorn.Server):
    """Uvicorn, which ends this process by the signal that it was told to end by; a drained server has done
    what it was told."""

    def __init__(self, service: Service, port: int, token: str | None, host: str | None = None):
        """`host` in place of the one that the options of the service have."""
        options = service.options
        self.service, self.told = service, 0
        self._host = host or options.host
        super().__init__(
            uvicorn.Config(
                gated(service, self._host, token),
                host=self._host,
                port=port,
                lifespan="off",
                log_config=None,
                access_log=False,
                server_header=False,
                limit_concurrency=CONNECTIONS,
                timeout_graceful_shutdown=max(1, round(options.grace_s)),
            )
        )
        logging.getLogger("uvicorn").setLevel(logging.WARNING)

    @property
    def port(self) -> int:
        """Where it listens, once it does."""
        (server, *_) = self.servers
        number: int = server.sockets[0].getsockname()[1]
        return number

    def serve_until_told(self) -> None:
        """Returns when everything is closed."""
        try:
            asyncio.run(self.serve())
        finally:
            self.service.close()

    def wait(self) -> None:
        """Returns when it listens. Raises `NeuGraspError` where it does not."""
        end = time.monotonic() + START_S
        while not self.started:
            if time.monotonic() > end:
                raise NeuGraspError(f"the server does not listen after {START_S:.0f} s")
            time.sleep(0.02)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listens, and says where."""
        await super().startup(sockets)
        if self.started:
            where = f"http://{_in_url(self._host)}:{self.port}"
            log.info("listening at %s: a page to drop photos on; %s/docs says how to ask", where, where)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begins to drain."""
        self.told = self.told or sig
        self.service.is_ready = False
        log.info("going down: what was begun is finished first")
        super().handle_exit(sig, frame)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """As uvicorn does it, without raising the signal again at the end."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        signals = (signal.SIGINT, signal.SIGTERM)
        before = {number: signal.signal(number, self.handle_exit) for number in signals}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def _in_url(host: str) -> str:
    return f"[{host}]" if ":" in host else host
