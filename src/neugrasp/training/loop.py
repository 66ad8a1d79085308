"""The training loop, readable from top to bottom: of any module that turns batches into losses."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from torch import nn
from torch.utils.data import DataLoader, Dataset

from neugrasp.errors import NeuGraspError
from neugrasp.progress import reached
from neugrasp.training.config import Optimiser
from neugrasp.training.distributed import Ranks
from neugrasp.training.early_stop import EarlyStop
from neugrasp.training.log import TrainingLog
from neugrasp.training.module import bfloat16_pays
from neugrasp.training.state import Identity, TrainState, save_state

log = logging.getLogger(__name__)


class Schedule(Protocol):
    """What the loop asks of a configuration."""

    @property
    def steps(self) -> int: ...

    @property
    def optimiser(self) -> Optimiser: ...

    @property
    def bfloat16(self) -> bool: ...

    @property
    def checkpoint_every(self) -> int: ...

    @property
    def validate_every(self) -> int: ...

    @property
    def patience(self) -> int: ...

    def learning_rate_at(self, step: int) -> float:
        """Learning rate of a step, counted from 0."""
        ...


@dataclass(frozen=True)
class Course:
    """What is trained, on what, and who judges it."""

    out: Path
    """Where log and states are written."""
    config: Schedule
    learner: TrainState[Any]
    losses: nn.Module
    """forward(batch, step) -> terms by name, what is minimised as "loss"; everything random in it follows
    from the step. It holds the learner's model."""
    batches: Dataset[Any]
    """The batch of every step, with `.to(device)`: a function of the step, so that a run resumes exactly."""
    identity: Identity
    ranks: Ranks
    judge: Callable[[Any, int], dict[str, float]] | None
    """Model, steps done -> scores by name."""
    keep: Callable[[int, dict[str, float]], None]
    """Writes the learner's weights after so many steps, with these scores."""
    loaders: int = 0
    """Processes that make batches ahead."""
    loggers: Sequence[str] = ()
    about: Any = None
    """The configuration, for loggers that show it."""


def follow(course: Course, start: int, last: int) -> None:
    """Steps `start` to `last` of a course, or fewer where its patience ends before.

    Raises `NeuGraspError` where the loss is no number.
    """
    config, ranks, learner, out = course.config, course.ranks, course.learner, course.out
    losses_of = ranks.wrap(course.losses)
    records = TrainingLog(out, start, course.loggers, course.about) if ranks.leads else None
    early = EarlyStop(out / "log.jsonl", config.patience)
    began = time.monotonic()
    try:
        if ranks.agree(early.is_over):
            return
        for step, batch in enumerate(loader(course.batches, start, last, course.loaders), start):
            losses = _step(losses_of, learner, batch.to(ranks.device), config, step, ranks)
            done = step + 1
            ends = done == config.steps
            validates = course.judge is not None and (done % config.validate_every == 0 or ends)
            if records is not None:
                reached("steps", done, config.steps)
                records.step(step, losses, config.learning_rate_at(step))
                if validates:
                    _validate(course, done, records, early)
            is_over = config.patience > 0 and validates and ranks.agree(early.is_over)
            # The state comes last: a run killed before it validates again, one killed after it has done so.
            if records is not None and (done % config.checkpoint_every == 0 or ends or is_over):
                save_state(out, learner, done, course.identity)
                _show_progress(done, config, losses, (time.monotonic() - began) / (done - start))
            if is_over:
                log.info("step %d: none of %d validations was better; the best stays", done, config.patience)
                return
    finally:
        if records is not None:
            records.close()


def loader(batches: Dataset[Any], first: int, last: int, workers: int) -> DataLoader[Any]:
    """The batches of steps `first` to `last`, made ahead by `workers` processes; 0: when they are needed."""
    options: dict[str, Any] = {"prefetch_factor": 2, "worker_init_fn": _one_thread} if workers else {}
    own = torch.Generator()  # the loader draws a seed, which must not move the global generator
    return DataLoader(
        batches, batch_size=None, sampler=range(first, last), num_workers=workers, generator=own, **options
    )


def _one_thread(_worker: int) -> None:
    torch.set_num_threads(1)


def _step(
    losses_of: nn.Module, learner: TrainState[Any], batch: Any, config: Schedule, step: int, ranks: Ranks
) -> dict[str, float]:
    """One update, and the losses of all ranks; everything random follows from the seed and the step."""
    for group in learner.optimizer.param_groups:
        group["lr"] = config.learning_rate_at(step)
    device = next(learner.model.parameters()).device
    reduced = config.bfloat16 and bfloat16_pays(device)
    with torch.autocast(device.type, torch.bfloat16, enabled=reduced):
        losses = losses_of(batch, step)
    # One transfer, so that a device waits for the processor once in a step.
    own = dict(zip(losses, torch.stack([*losses.values()]).detach().tolist(), strict=True))
    values = ranks.mean(own)  # before the check, so that all of them stop where one has no number
    if not np.isfinite(values["loss"]):
        raise NeuGraspError(f"step {step}: the loss is {values['loss']}; the last state before it is kept")
    losses["loss"].backward()
    learner.update(config.optimiser.gradient_clip)
    return values


def _validate(course: Course, step: int, records: TrainingLog, early: EarlyStop) -> None:
    assert course.judge is not None
    scores = course.judge(course.learner.smooth, step)
    records.validation(step, scores)
    if early.add(scores):
        course.keep(step, scores)
    said = {name: round(value, 3) for name, value in scores.items() if " " not in name}
    log.info("step %d validation: %s", step, said)


def _show_progress(step: int, config: Schedule, losses: dict[str, float], seconds: float) -> None:
    left = (config.steps - step) * seconds / 60
    terms = " ".join(f"{name} {value:.4f}" for name, value in losses.items())
    log.info("step %d / %d  %s  %.2f s a step, %.0f min left", step, config.steps, terms, seconds, left)
