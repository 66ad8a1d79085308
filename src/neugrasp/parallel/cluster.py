"""Actors of a Ray cluster: the only file that imports Ray.

Each actor opens what it needs once and does one task after the other; results come back to this process. What
tasks write must lie where every machine sees it.
"""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from neugrasp.errors import InputError, NeuGraspError, require
from neugrasp.parallel.crew import Opener, Worker, told

log = logging.getLogger(__name__)

AUTO = "auto"
"""The cluster that runs on this machine, or one that is started for as long as the work lasts."""
KNOCK_S = 5.0
"""Seconds in which a cluster takes a connection."""
CLOSE_S = 30.0
"""Seconds that an actor has to put away what it opened."""


@dataclass(frozen=True)
class Cluster:
    """Workers of a cluster."""

    address: str
    """`auto`, or what `ray start` says: HOST:6379."""
    count: int | None = None
    """By default one for each processor of the cluster."""

    @contextmanager
    def open(self, opener: Opener[Any, Any]) -> Iterator[Sequence[Worker]]:
        """One worker for each actor. Raises `InputError` where there is no such cluster."""
        ray = require("ray", extra="cluster")
        was_connected = ray.is_initialized()
        if not was_connected:
            _connect(ray, self.address)
        workers: list[_Actor] = []
        try:
            cores = int(ray.cluster_resources().get("CPU", 0))
            count = self.count or cores
            if not 1 <= count <= cores:
                raise InputError(f"--workers {count}: the cluster at {self.address} has {cores} processors")
            log.info("%d workers on %d machines", count, len([n for n in ray.nodes() if n["Alive"]]))
            workers += [_Actor(ray, opener) for _ in range(count)]
            yield workers
        finally:
            for worker in workers:
                worker.close()
            if not was_connected:
                ray.shutdown()


def _connect(ray: Any, address: str) -> None:
    if address != AUTO:
        _check_there(address)
    # Ray tells its makers how it is used unless it is asked not to.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    options = {"log_to_driver": False, "logging_level": logging.WARNING}
    try:
        ray.init(address=address, **options)
    except ConnectionError as error:
        if address != AUTO:
            raise InputError(f"--cluster {address}: is no Ray cluster ({error})") from error
        log.info("no Ray cluster runs here: one is started for this work")
        ray.init(include_dashboard=False, **options)


def _check_there(address: str) -> None:
    """Raises `InputError` where nothing listens: Ray itself would try for minutes."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal():
        raise InputError(f"--cluster {address}: give auto, or the address that `ray start` says: HOST:6379")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=KNOCK_S).close()
    except (OSError, OverflowError) as error:
        raise InputError(f"--cluster {address}: no Ray cluster answers there ({error})") from error


class _Actor:
    """An actor, and one in its place where it died."""

    def __init__(self, ray: Any, opener: Opener[Any, Any]):
        self._ray, self._opener = ray, opener
        self._actor: Any = self._new()

    def _new(self) -> Any:
        return self._ray.remote(num_cpus=1, max_restarts=0)(Opened).remote(self._opener)

    def begin(self, task: Any) -> Future[Any]:
        """Hands a task over."""
        future: Future[Any] = self._actor.work.remote(task).future()
        return future

    def has_died(self, error: BaseException) -> bool:
        """Whether the actor, or the machine that it was on, is gone.

        Raises `NeuGraspError` where it never came to be: another one would not, either.
        """
        if not isinstance(error, self._ray.exceptions.RayActorError):
            return False
        if error.actor_init_failed:
            reason = str(error).strip().splitlines()[-1]
            raise NeuGraspError(f"no worker starts; is neugrasp installed on every machine? ({reason})")
        return True

    def revive(self) -> bool:
        """Another actor, if a processor is free."""
        if self._ray.available_resources().get("CPU", 0) < 1:
            return False
        self._actor = self._new()
        return True

    def close(self) -> None:
        """Ends the actor when it has put away what it opened."""
        with suppress(self._ray.exceptions.RayError):
            self._ray.get(self._actor.close.remote(), timeout=CLOSE_S)
        with suppress(self._ray.exceptions.RayError):
            self._ray.kill(self._actor)


class Opened:
    """What an actor is: something that is opened with the first task."""

    def __init__(self, opener: Opener[Any, Any]):
        self._opener, self._closing = opener, ExitStack()
        self._work: Callable[[Any], Any] | None = None

    def work(self, task: Any) -> Any:
        """The result, or why there is none."""
        return told(lambda one: self._there()(one), task)

    def _there(self) -> Callable[[Any], Any]:
        if self._work is None:
            self._work = self._closing.enter_context(self._opener())
        return self._work

    def close(self) -> None:
        """Puts away what was opened."""
        self._closing.close()
        self._work = None
