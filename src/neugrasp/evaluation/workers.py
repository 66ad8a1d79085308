"""Rounds shared among processes, which end with the one that started them."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from multiprocessing.util import Finalize

import torch

from neugrasp.errors import InputError, NeuGraspError
from neugrasp.evaluation.bench import Bench, needs_photographer
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.episode import Episode
from neugrasp.long_runs import end_with
from neugrasp.simulation.cell_photos import Photographer

MakePhotographer = Callable[[int], AbstractContextManager[Photographer]]
"""Number of threads -> a photographer to be used in a with statement."""


def play_all(
    config: Evaluate, indices: list[int], make_photographer: MakePhotographer
) -> Generator[Episode, None, None]:
    """The rounds as they are finished, in no particular order."""
    if not indices:
        return
    num_cores = len(os.sched_getaffinity(0))
    workers = min(config.workers or num_cores, len(indices))
    threads = max(1, num_cores // workers)
    if workers == 1:
        with _one_thread(), ExitStack() as closing:
            bench = open_bench(config, make_photographer, threads, closing)
            for index in indices:
                yield bench.play(index)
        return
    context = multiprocessing.get_context("spawn")
    arguments = (config, make_photographer, threads, os.getpid())
    pool = ProcessPoolExecutor(workers, context, _start, arguments)
    try:
        waiting = {pool.submit(_play, index) for index in indices}
        while waiting:
            done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                yield future.result()
    except BrokenProcessPool as error:
        raise NeuGraspError("a worker was killed (out of memory?); run the command again to go on") from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def open_bench(
    config: Evaluate, make_photographer: MakePhotographer, threads: int, closing: ExitStack
) -> Bench:
    """A bench that is closed with `closing`."""
    photographer = make_photographer(threads) if needs_photographer(config) else nullcontext()
    bench = Bench(config, closing.enter_context(photographer))
    closing.enter_context(bench.world)
    return bench


@contextmanager
def _one_thread() -> Iterator[None]:
    """One thread for the networks, as in every worker: sums come out the same however many share the work."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


_bench: list[Callable[[], Bench]] = []


def _start(config: Evaluate, make_photographer: MakePhotographer, threads: int, parent: int) -> None:
    """Prepares a worker process; its bench is opened with the first round."""
    torch.set_num_threads(1)
    end_with(parent)
    closing = ExitStack()
    Finalize(None, closing.close, exitpriority=10)
    opened: list[Bench] = []

    def bench() -> Bench:
        if not opened:
            opened.append(open_bench(config, make_photographer, threads, closing))
        return opened[0]

    _bench.append(bench)


def _play(index: int) -> Episode:
    try:
        return _bench[0]().play(index)
    except NeuGraspError as error:
        # Some of our errors do not survive the way to the parent; their text does.
        kind = InputError if isinstance(error, InputError) else NeuGraspError
        raise kind(str(error)) from None
