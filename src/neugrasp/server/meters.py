"""What Prometheus reads at /metrics: the only file that imports its client."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector, generate_latest
from prometheus_client.exposition import CONTENT_TYPE_LATEST

MEDIA_TYPE = CONTENT_TYPE_LATEST
SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 0.75, 1.0, 1.5, 2.5, 5.0, 10.0, 30.0, 60.0)
"""Upper ends of the histogram's parts: a detection takes half a second on two cores."""


class Meters:
    """Counters of one server."""

    def __init__(self) -> None:
        self._registry = CollectorRegistry()
        ProcessCollector(registry=self._registry)

        def made(kind: Any, name: str, what: str, labels: tuple[str, ...] = (), **options: Any) -> Any:
            return kind(f"neugrasp_{name}", what, labels, registry=self._registry, **options)

        self._stages = made(Histogram, "stage_seconds", "Seconds by stage", ("stage",), buckets=SECONDS)
        self._requests = made(Counter, "requests", "Requests answered", ("route", "status"))
        self._refused = made(Counter, "refused_requests", "Requests that got no detection", ("reason",))
        self._candidates = made(Counter, "rejected_candidates", "Grasps rejected, by rule", ("reason",))
        self._grasps = made(Counter, "grasps", "Grasps given out")
        self._verdicts = made(Counter, "doctor_verdicts", "The doctor's word on captures", ("level",))
        self._backgrounds = made(Gauge, "backgrounds", "Feature maps of cells, found or made", ("result",))
        self._queue = made(Gauge, "held_requests", "Requests held: waiting, and being answered")
        self._cells = made(Gauge, "cells", "Cells that are kept")

    def watch(
        self, held: Callable[[], int], cells: Callable[[], int], backgrounds: Callable[[], tuple[int, int]]
    ) -> None:
        """Reads these whenever it is asked: requests held, cells, hits and misses of backgrounds."""
        self._queue.set_function(held)
        self._cells.set_function(cells)
        self._backgrounds.labels("hit").set_function(lambda: backgrounds()[0])
        self._backgrounds.labels("miss").set_function(lambda: backgrounds()[1])

    def spent(self, seconds: Mapping[str, float]) -> None:
        """Seconds by stage of one request."""
        for stage, spent in seconds.items():
            self._stages.labels(stage).observe(spent)

    def answered(self, route: str, status: int) -> None:
        """A request has its answer."""
        self._requests.labels(route, str(status)).inc()

    def refused(self, reason: str) -> None:
        """A request got no detection."""
        self._refused.labels(reason).inc()

    def found(self, grasps: int, rejected: Mapping[str, int]) -> None:
        """What a detection held."""
        self._grasps.inc(grasps)
        for reason, count in rejected.items():
            self._candidates.labels(reason).inc(count)

    def judged(self, level: str) -> None:
        """The doctor saw a capture."""
        self._verdicts.labels(level).inc()

    def page(self) -> bytes:
        """The text that Prometheus reads."""
        return generate_latest(self._registry)
