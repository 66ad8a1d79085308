"""Rounds shared among workers, each with a bench of its own."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial

import torch

from neugrasp.evaluation.bench import Bench, needs_photographer
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.episode import Episode
from neugrasp.evaluation.protocols import Protocol as Rules
from neugrasp.parallel.choice import crew_for
from neugrasp.parallel.crew import spread
from neugrasp.simulation.cell_photos import Photographer

MakePhotographer = Callable[[int], AbstractContextManager[Photographer]]
"""Number of threads -> a photographer to be used in a with statement."""


def play_all(
    config: Evaluate, indices: list[int], make_photographer: MakePhotographer
) -> Generator[Episode, None, None]:
    """The rounds as they are finished, in no particular order."""
    if not indices:
        return
    crew, threads = crew_for(config.workers, len(indices), config.cluster)
    opener = partial(_rounds, config, make_photographer, threads)
    yield from spread(crew, opener, ([index] for index in indices))


@contextmanager
def open_bench(
    config: Evaluate,
    make_photographer: MakePhotographer,
    threads: int,
    rules: Rules | None = None,
    speed: float = 1.0,
) -> Iterator[Bench]:
    """A bench with its world and its photographer, who may use so many threads."""
    photographer = make_photographer(threads) if needs_photographer(config) else nullcontext()
    with photographer as one:
        bench = Bench(config, one, rules, speed)
        with bench.world:
            yield bench


@contextmanager
def _rounds(
    config: Evaluate, make_photographer: MakePhotographer, threads: int
) -> Iterator[Callable[[int], Episode]]:
    """What plays a round of a number."""
    with _one_thread(), open_bench(config, make_photographer, threads) as bench:
        yield bench.play


@contextmanager
def _one_thread() -> Iterator[None]:
    """One thread for the networks, in every worker: sums come out the same however many share the work."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
