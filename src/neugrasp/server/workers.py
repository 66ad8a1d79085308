"""Who answers: one thread on each device, and a bounded number of requests that wait for it."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any, TypeVar

from neugrasp.detection.contract import Detector

Result = TypeVar("Result")
GUESS_S, RECENT = 1.0, 0.2
"""Seconds that a detection takes before one was measured, and the weight of the newest one in the mean."""


class Busy(Exception):
    """There is no room for another request."""

    def __init__(self, retry_after_s: int):
        super().__init__(f"this server holds as many requests as it may; try again in {retry_after_s} s")
        self.retry_after_s = retry_after_s


class TooSlow(Exception):
    """The answer took longer than a request may take."""


class Gone(Exception):
    """Nobody waits for the answer."""


class Workers:
    """Detectors, each used by one thread at a time."""

    def __init__(self, detectors: Sequence[Detector[Any]], held_at_most: int):
        self.detectors = tuple(detectors)
        self.held_at_most = held_at_most
        self.held = 0
        """Requests that wait or are being answered."""
        self._mean_s = GUESS_S
        self._free: SimpleQueue[Detector[Any]] = SimpleQueue()
        for detector in detectors:
            self._free.put(detector)
        self._pool = ThreadPoolExecutor(len(self.detectors), "detector")

    @contextmanager
    def room(self) -> Iterator[None]:
        """Holds a place while the block lasts. Raises `Busy` where there is none."""
        if self.held >= self.held_at_most:
            waiting = math.ceil(self._mean_s * self.held / len(self.detectors))
            raise Busy(max(1, waiting))
        self.held += 1
        try:
            yield
        finally:
            self.held -= 1

    async def run(
        self, job: Callable[[Detector[Any]], Result], patience_s: float, gone: Callable[[], Awaitable[Any]]
    ) -> tuple[Result, float]:
        """What a job makes of a detector that is free, and the seconds that it waited.

        A job that has not begun is dropped where `gone` comes first (`Gone`) or patience ends (`TooSlow`);
        one that has begun is finished, and its result forgotten.
        """
        asked = time.perf_counter()
        begun: list[float] = []

        def work() -> Result:
            begun.append(time.perf_counter())
            detector = self._free.get()
            try:
                return job(detector)
            finally:
                self._free.put(detector)
                self._mean_s += RECENT * (time.perf_counter() - begun[0] - self._mean_s)

        future = self._pool.submit(work)
        answer = asyncio.ensure_future(asyncio.wrap_future(future))
        left = asyncio.ensure_future(gone())
        try:
            done, _ = await asyncio.wait(
                {answer, left}, timeout=patience_s, return_when=asyncio.FIRST_COMPLETED
            )
            if answer in done:
                return answer.result(), begun[0] - asked
            raise Gone if left in done else TooSlow
        finally:
            left.cancel()
            answer.cancel()

    async def everywhere(self, job: Callable[[Detector[Any]], object]) -> None:
        """Runs a job with every detector, each as soon as a thread is free."""
        loop = asyncio.get_running_loop()
        for detector in self.detectors:
            await loop.run_in_executor(self._pool, job, detector)

    def close(self) -> None:
        """Ends when what has begun is finished."""
        self._pool.shutdown(wait=True, cancel_futures=True)
