"""Rounds shared among workers, each with a runner of its own."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial

import torch

from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.episode import Episode
from neugrasp.evaluation.episode_runner import EpisodeRunner, needs_scene_renderer
from neugrasp.evaluation.protocols import EvaluationRules
from neugrasp.parallel.choice import crew_for
from neugrasp.parallel.crew import spread
from neugrasp.simulation.cell_photos import SceneRenderer

MakeSceneRenderer = Callable[[int], AbstractContextManager[SceneRenderer]]
"""Number of threads -> a scene renderer to be used in a with statement."""


def play_all(
    config: Evaluate, indices: list[int], make_scene_renderer: MakeSceneRenderer
) -> Generator[Episode, None, None]:
    """The rounds as they are finished, in no particular order."""
    if not indices:
        return
    crew, threads = crew_for(config.workers, len(indices), config.cluster)
    opener = partial(_rounds, config, make_scene_renderer, threads)
    yield from spread(crew, opener, ([index] for index in indices))


@contextmanager
def open_runner(
    config: Evaluate,
    make_scene_renderer: MakeSceneRenderer,
    threads: int,
    rules: EvaluationRules | None = None,
    speed: float = 1.0,
) -> Iterator[EpisodeRunner]:
    """A runner with its world and its scene renderer, which may use so many threads."""
    scene_renderer = make_scene_renderer(threads) if needs_scene_renderer(config) else nullcontext()
    with scene_renderer as one:
        runner = EpisodeRunner(config, one, rules, speed)
        with runner.world:
            yield runner


@contextmanager
def _rounds(
    config: Evaluate, make_scene_renderer: MakeSceneRenderer, threads: int
) -> Iterator[Callable[[int], Episode]]:
    """What plays a round of a number."""
    with one_thread(), open_runner(config, make_scene_renderer, threads) as runner:
        yield runner.play


@contextmanager
def one_thread() -> Iterator[None]:
    """One thread for the networks, in every worker: sums come out the same however many share the work."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
