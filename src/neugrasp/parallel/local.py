"""Processes of this machine, which end with the one that started them."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from multiprocessing.util import Finalize
from typing import Any

from neugrasp.parallel.crew import Opener, Worker, told
from neugrasp.run_folder import exit_with_parent


@dataclass(frozen=True)
class Here:
    """This process alone."""

    @contextmanager
    def open(self, opener: Opener[Any, Any]) -> Iterator[Sequence[Worker]]:
        """One worker that does a task as soon as it gets it."""
        with opener() as work:
            yield [_Here(work)]


@dataclass(frozen=True, eq=False)
class _Here:
    work: Callable[[Any], Any]

    def begin(self, task: Any) -> Future[Any]:
        """Does it."""
        future: Future[Any] = Future()
        future.set_result(self.work(task))
        return future

    def has_died(self, error: BaseException) -> bool:
        """Never."""
        return False

    def revive(self) -> bool:
        """Always there."""
        return True


@dataclass(frozen=True)
class Processes:
    """So many of them."""

    count: int

    @contextmanager
    def open(self, opener: Opener[Any, Any]) -> Iterator[Sequence[Worker]]:
        """One worker for each process; each opens what it needs with its first task."""
        workers = [_Process(opener) for _ in range(self.count)]
        try:
            yield workers
        finally:
            for worker in workers:
                worker.close()


class _Process:
    """A process that does one task after the other."""

    def __init__(self, opener: Opener[Any, Any]):
        self._opener = opener
        self._pool = self._new()

    def _new(self) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(1, context, _start, (self._opener, os.getpid()))

    def begin(self, task: Any) -> Future[Any]:
        """Hands a task over."""
        return self._pool.submit(_work, task)

    def has_died(self, error: BaseException) -> bool:
        """Whether the process is gone."""
        return isinstance(error, BrokenProcessPool)

    def revive(self) -> bool:
        """Starts another process."""
        self.close()
        self._pool = self._new()
        return True

    def close(self) -> None:
        """Ends the process when it has done its task and put away what it opened."""
        self._pool.shutdown(wait=True, cancel_futures=True)


_opened: list[Callable[[], Callable[[Any], Any]]] = []


def _start(opener: Opener[Any, Any], parent: int) -> None:
    """Prepares a process; what it needs is opened with its first task."""
    exit_with_parent(parent)
    closing = ExitStack()
    Finalize(None, closing.close, exitpriority=10)
    made: list[Callable[[Any], Any]] = []

    def work() -> Callable[[Any], Any]:
        if not made:
            made.append(closing.enter_context(opener()))
        return made[0]

    _opened.append(work)


def _work(task: Any) -> Any:
    return told(lambda one: _opened[0]()(one), task)
