"""The training loop, readable from top to bottom."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch

from neugrasp.data.records import Record
from neugrasp.errors import InputError, NeuGraspError
from neugrasp.long_runs import source_commit
from neugrasp.model.checkpoint import load_checkpoint, save_checkpoint
from neugrasp.model.network import NeuGrasp
from neugrasp.training.config import TrainConfig
from neugrasp.training.data import TrainingSet, read_records
from neugrasp.training.log import TrainingLog
from neugrasp.training.progress_picture import save_progress_picture
from neugrasp.training.recipes import recipe
from neugrasp.training.samples import Sample, Truth
from neugrasp.training.state import Learner, load_state, save_state
from neugrasp.training.step import bfloat16_pays, head_loss, joint_losses, total
from neugrasp.training.validation import validate, validate_head

log = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class TrainRun:
    """Where a run reads and writes."""

    recipe: str
    data: tuple[Path, ...]
    """Folders of shards or records to train on."""
    out: Path
    validation: tuple[Path, ...] = ()
    """Folders to validate on; without any, the last twentieth of the data is kept aside for it."""
    device: str = "cpu"
    steps: int | None = None
    """Overrides the recipe's number of steps; the stages shrink or grow with it."""
    resume: bool = False
    init: str | None = None
    """Weights to start from, by name or file, instead of random ones; of another network than the recipe's
    only the grasp head is taken. The head's stage then lies behind."""
    seed: int = 0
    scenes: int | None = None
    """So many of all scenes, evenly spread; by default all."""
    compile: bool = False
    """Compiles what is slow of the network first, for steps on a CPU."""


def configured(run: TrainRun) -> TrainConfig:
    """The recipe with the run's facts in it."""
    config = replace(recipe(run.recipe), seed=run.seed)
    if run.init and config.steps > config.head_steps:
        config = replace(config, steps=config.steps - config.head_steps, head_steps=0)
    if run.steps is None:
        return config
    if run.steps < 1:
        raise InputError(f"--steps {run.steps}: must be at least 1")
    return replace(config, steps=run.steps, head_steps=round(config.head_steps * run.steps / config.steps))


def train(run: TrainRun, stop_after: int | None = None) -> Path:
    """Trains and gives the path of the weights; `stop_after` ends early, as an interruption would.

    Raises `InputError` where data, recipe or an earlier run in `out` do not fit.
    """
    config = configured(run)
    _check_out(run)
    torch.manual_seed(config.seed)
    model = NeuGrasp(config.model)
    if run.init:
        _start_from(model, run.init)
    model.to(run.device).train()
    if run.compile:
        model.field.fuse()
    learner = Learner.of(model, config)
    start = load_state(run.out, learner, config)
    data, held_out = _open_data(run, config)
    records = TrainingLog(run.out, start)
    last = min(config.steps, stop_after or config.steps)
    began = time.monotonic()
    try:
        for step in range(start, last):
            losses = _step(learner, data, config, step)
            records.step(step, losses, config.learning_rate_at(step))
            done = step + 1
            if held_out and (done % config.validate_every == 0 or done == config.steps):
                _validate(learner.smooth, config, run, held_out, done, records)
            # The state comes last: a run killed before it validates again, one killed after it has done so.
            if done % config.checkpoint_every == 0 or done == config.steps:
                save_state(run.out, learner, done, config)
                _show_progress(done, config, losses, (time.monotonic() - began) / (done - start))
    finally:
        data.close()
        records.close()
    weights = run.out / "weights.safetensors"
    save_checkpoint(weights, learner.smooth, _about(run, config, last, len(data)))
    return weights


def _check_out(run: TrainRun) -> None:
    if any(run.out.glob("*.safetensors")) and not run.resume:
        raise InputError(
            f"{run.out}: holds an earlier run; add --resume to go on with it or choose another --out"
        )
    try:
        run.out.mkdir(parents=True, exist_ok=True)
        for half_written in run.out.glob(".*.safetensors.*"):
            half_written.unlink()
    except OSError as error:
        raise NeuGraspError(f"{run.out}: cannot be made ({error.strerror})") from error


def _start_from(model: NeuGrasp, weights: str) -> None:
    checkpoint = load_checkpoint(weights)
    tensors = {name: tensor.float() for name, tensor in checkpoint.tensors.items()}
    if checkpoint.config == model.config:
        model.load_state_dict(tensors)
        return
    if checkpoint.config.head_channels != model.config.head_channels:
        raise InputError(f"{weights}: its network is configured differently from the recipe's, its head too")
    log.warning("%s: another network than the recipe's, so only its grasp head is taken", weights)
    prefix = "head."
    head = {name.removeprefix(prefix): each for name, each in tensors.items() if name.startswith(prefix)}
    model.head.load_state_dict(head)


class _HeldOut:
    """Some scenes that are not trained on."""

    def __init__(self, records: list[Record], config: TrainConfig):
        self._data = TrainingSet(records, config.model.image_size, config.seed)
        self._with_photos = _spread(self._data.photographed, config.validation_scenes)
        self._any = _spread(range(len(records)), 10 * config.validation_scenes)

    def __bool__(self) -> bool:
        return bool(self._any)

    @cached_property
    def samples(self) -> list[Sample]:
        """With photos; made when first asked for."""
        return [self._data.plain(index) for index in self._with_photos]

    @cached_property
    def truths(self) -> list[Truth]:
        """With or without photos, and more of them: the head is quick."""
        return [self._data.plain_truth(index) for index in self._any]


def _spread(things: Sequence[T], count: int) -> list[T]:
    """At most `count` of the things, evenly."""
    places = np.linspace(0, len(things) - 1, min(count, len(things))).astype(int)
    return [things[place] for place in places.tolist()]


def _open_data(run: TrainRun, config: TrainConfig) -> tuple[TrainingSet, _HeldOut]:
    """The training set, and what is validated on."""
    records = _read_all(run.data)
    if run.scenes is not None:
        if not 1 <= run.scenes <= len(records):
            raise InputError(f"--scenes {run.scenes}: --data holds 1 to {len(records)}")
        records = _spread(records, run.scenes)
    if run.validation:
        held = _read_all(run.validation)
    else:
        keep = len(records) - len(records) // 20
        records, held = records[:keep], records[keep:]
    data = TrainingSet(records, config.model.image_size, config.seed)
    if config.steps > config.head_steps and not data.photographed:
        folders = ", ".join(map(str, run.data))
        raise InputError(f"{folders}: no scene has photos; recipe {run.recipe} needs some, head none")
    return data, _HeldOut(held, config)


def _read_all(folders: tuple[Path, ...]) -> list[Record]:
    return [record for folder in folders for record in read_records(folder)]


def _step(learner: Learner, data: TrainingSet, config: TrainConfig, step: int) -> dict[str, float]:
    """One update; everything random in it follows from the seed and the step's number."""
    model = learner.model
    generator = torch.Generator().manual_seed(config.seed * 1_000_003 + step)
    for group in learner.optimizer.param_groups:
        group["lr"] = config.learning_rate_at(step)
    device = next(model.parameters()).device
    reduced = config.bfloat16 and bfloat16_pays(device)
    with torch.autocast(device.type, torch.bfloat16, enabled=reduced):
        if step < config.head_steps:
            losses = {"grasp": head_loss(model, _truths(data, config, step), generator)}
        else:
            sample = data.take(step - config.head_steps).to(device)
            losses = joint_losses(model, sample, config, config.sharpness_at(step), generator)
            if config.weights.rehearsal:
                losses["rehearsal"] = head_loss(model, _truths(data, config, step), generator)
        loss = total(losses, config)
    if not torch.isfinite(loss):
        raise NeuGraspError(
            f"step {step}: the loss is {float(loss.detach())}; the last state before it is kept"
        )
    loss.backward()
    learner.update(config.gradient_clip)
    return {"loss": float(loss.detach()), **{name: float(value.detach()) for name, value in losses.items()}}


def _truths(data: TrainingSet, config: TrainConfig, step: int) -> list[Truth]:
    return data.truths_at(step * config.head_batch, config.head_batch)


def _validate(
    model: NeuGrasp, config: TrainConfig, run: TrainRun, held_out: _HeldOut, step: int, records: TrainingLog
) -> None:
    device = next(model.parameters()).device
    model.to("cpu")
    scores = validate_head(model, held_out.truths)
    sharpness = config.sharpness_at(step)
    if held_out.samples and step > config.head_steps:
        scores |= validate(model, held_out.samples, sharpness)
        save_progress_picture(run.out / f"progress_{step:06d}.png", model, held_out.samples[0], sharpness)
    records.validation(step, scores)
    save_checkpoint(run.out / "weights.safetensors", model, _about(run, config, step, 0))
    model.to(device)
    log.info("step %d validation: %s", step, {name: round(value, 3) for name, value in scores.items()})


def _show_progress(step: int, config: TrainConfig, losses: dict[str, float], seconds: float) -> None:
    left = (config.steps - step) * seconds / 60
    terms = " ".join(f"{name} {value:.4f}" for name, value in losses.items())
    log.info("step %d / %d  %s  %.2f s a step, %.0f min left", step, config.steps, terms, seconds, left)


def _about(run: TrainRun, config: TrainConfig, steps: int, scenes: int) -> dict[str, Any]:
    began = {"init": Path(run.init).name} if run.init else {}
    facts = {"recipe": run.recipe, **began, "steps": steps, "seed": config.seed, "scenes": scenes}
    return {**facts, "commit": source_commit()}
