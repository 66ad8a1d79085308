"""The training loop, readable from top to bottom."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from torch import nn

from neugrasp.errors import InputError, NeuGraspError
from neugrasp.geometry.symmetry import Symmetry
from neugrasp.long_runs import held, source_commit
from neugrasp.model.checkpoint import load_checkpoint, save_checkpoint
from neugrasp.model.compute import Compute
from neugrasp.model.network import NeuGrasp
from neugrasp.progress import reached
from neugrasp.terminal import next_step
from neugrasp.training.command import Train
from neugrasp.training.config import TrainConfig
from neugrasp.training.dataset import Batch, Records, Scenes, Steps, identity_of, loader, open_records
from neugrasp.training.distributed import Ranks, joined_ranks
from neugrasp.training.log import TrainingLog
from neugrasp.training.module import TrainingModule, bfloat16_pays
from neugrasp.training.networks import NetworkSpec, network_spec
from neugrasp.training.recipes import configured
from neugrasp.training.samples import Sample, Truth
from neugrasp.training.state import Identity, Learner, read_state, save_state

log = logging.getLogger(__name__)

T = TypeVar("T")
HELD_OUT = 20
"""One scene of so many is kept aside for validation where no folder is given for it."""


def run(options: Train, config: TrainConfig | None = None) -> str:
    """`neugrasp train`: the path of the weights, and what to do with them."""
    weights = train(options, config=config)
    rounds = weights.parent / "rounds"
    tried = next_step("evaluate", "--weights", weights, "--split", "train", "--out", rounds)
    return f"{weights}\n{tried}\n{next_step('predict', 'MY_SCENE', '--weights', weights, '--out', 'out')}"


def train(run: Train, stop_after: int | None = None, config: TrainConfig | None = None) -> Path:
    """Trains and gives the path of the weights; `stop_after` ends early, as an interruption would.

    Without a `config`, that of the run's recipe. Raises `InputError` where data, configuration or an earlier
    run in `out` do not fit, or another process trains there.
    """
    # Of the processes that torchrun started, the first one writes.
    leads = os.environ.get("RANK", "0") == "0"
    with held(run.out, "train") if leads else nullcontext():
        _check_out(run)
        return _trained(run, config or configured(run), stop_after)


def _trained(run: Train, config: TrainConfig, stop_after: int | None) -> Path:
    if saved := read_state(run.out):
        # However long the run becomes, the head's stage was as long as it was.
        config = replace(config, head_steps=saved.steps_of_head(config.head_steps))
    torch.manual_seed(config.seed)
    scenes, held_out = _open_data(run, config)
    spec = network_spec(config.network)
    model: Any = spec.build(config.model, scenes.workspace)
    if run.init:
        _start_from(model, run.init)
    device = Compute.of(run.device).device
    if run.precision == "bfloat16" and not bfloat16_pays(device):
        log.warning("--precision bfloat16: slower than float32 on this processor, which is used instead")
    with joined_ranks(run.device) as ranks:
        model.to(ranks.device).train()
        learner = Learner.of(model, config)
        identity = Identity(config, identity_of(scenes), run.init and Path(run.init).name)
        start = saved.restore(learner, identity) if saved else 0
        last = min(config.steps, stop_after or config.steps)
        if start < last:
            _train(
                _Run(run, config, spec, ranks, learner, identity, held_out, len(scenes)), scenes, start, last
            )
        weights = run.out / "weights.safetensors"
        if ranks.leads:
            about = _about(run, config, last, len(scenes))
            save_checkpoint(weights, learner.smooth, about, network=config.network)
    return weights


@dataclass(frozen=True)
class _Run:
    """What stays the same from step to step."""

    run: Train
    config: TrainConfig
    spec: NetworkSpec
    ranks: Ranks
    learner: Learner[Any]
    identity: Identity
    held_out: _HeldOut
    num_scenes: int


def _train(this: _Run, scenes: Scenes, start: int, last: int) -> None:
    """Steps `start` to `last`."""
    config, ranks, learner, out = this.config, this.ranks, this.learner, this.run.out
    module = ranks.wrap(TrainingModule(learner.model, this.spec.losses, config, ranks.rank))
    steps = Steps(scenes, config, ranks.rank, ranks.count)
    about = asdict(config) | {"recipe": this.run.recipe}
    records = TrainingLog(out, start, this.run.loggers, about) if ranks.leads else None
    began = time.monotonic()
    try:
        for step, batch in enumerate(loader(steps, start, last, this.run.loaders), start):
            losses = _step(module, learner, batch.to(ranks.device), config, step)
            if records is None:
                continue
            reached("steps", step + 1, config.steps)
            records.step(step, losses, config.learning_rate_at(step))
            done = step + 1
            if this.held_out and (done % config.validate_every == 0 or done == config.steps):
                _validate(this, done, records)
            # The state comes last: a run killed before it validates again, one killed after it has done so.
            if done % config.checkpoint_every == 0 or done == config.steps:
                save_state(out, learner, done, this.identity)
                _show_progress(done, config, losses, (time.monotonic() - began) / (done - start))
    finally:
        if records is not None:
            records.close()


def _check_out(run: Train) -> None:
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


def _start_from(model: nn.Module, weights: str) -> None:
    if not isinstance(model, NeuGrasp):
        raise InputError(f"--init {weights}: only the network neugrasp starts from weights")
    checkpoint = load_checkpoint(weights)
    if checkpoint.workspace.cube != model.workspace.cube:
        log.warning(
            "%s: was trained for %s; the scenes are about %s",
            weights,
            checkpoint.workspace.describe(),
            model.workspace.describe(),
        )
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

    def __init__(self, scenes: Scenes, config: TrainConfig):
        self._scenes = scenes
        self._with_photos = _spread(scenes.photographed, config.validation_scenes)
        self._any = _spread(range(len(scenes)), 10 * config.validation_scenes)

    def __bool__(self) -> bool:
        return bool(self._any)

    @cached_property
    def samples(self) -> list[Sample]:
        """With photos; made when first asked for."""
        return [self._scenes.sample(index, None) for index in self._with_photos]

    @cached_property
    def truths(self) -> list[Truth]:
        """With or without photos, and more of them: the head is quick."""
        return [self._scenes.truth(index, Symmetry()) for index in self._any]


def _spread(things: Sequence[T], count: int) -> list[T]:
    """At most `count` of the things, evenly."""
    places = np.linspace(0, len(things) - 1, min(count, len(things))).astype(int)
    return [things[place] for place in places.tolist()]


def _open_data(run: Train, config: TrainConfig) -> tuple[Scenes, _HeldOut]:
    """The training scenes, and what is validated on."""
    folders = [_places(folder) for folder in run.data]
    places = [place for folder in folders for place in folder]
    if run.scenes is not None:
        if not 1 <= run.scenes <= len(places):
            raise InputError(f"--scenes {run.scenes}: --data holds 1 to {len(places)}")
        places = _spread(places, run.scenes)
    if run.validation:
        held = [place for folder in run.validation for place in _places(folder)]
    else:
        # Of every folder, so that each kind of scene is validated on.
        held = places[HELD_OUT - 1 :: HELD_OUT]
        places = [place for index, place in enumerate(places) if index % HELD_OUT != HELD_OUT - 1]
    size, finds_changes = config.model.image_size, config.weights.finds_changes
    scenes = Scenes(places, size, finds_changes, reads_targets=finds_changes)
    if config.steps > config.head_steps and not scenes.photographed:
        names = ", ".join(map(str, run.data))
        raise InputError(f"{names}: no scene has photos; recipe {run.recipe} needs some, head none")
    return scenes, _HeldOut(Scenes(held, size, finds_changes), config)


def _places(folder: Path) -> list[tuple[Records, int]]:
    records = open_records(folder)
    return [(records, index) for index in range(len(records))]


def _step(
    module: nn.Module, learner: Learner[Any], batch: Batch, config: TrainConfig, step: int
) -> dict[str, float]:
    """One update; everything random in it follows from the seed and the step's number."""
    for group in learner.optimizer.param_groups:
        group["lr"] = config.learning_rate_at(step)
    device = next(learner.model.parameters()).device
    reduced = config.bfloat16 and bfloat16_pays(device)
    with torch.autocast(device.type, torch.bfloat16, enabled=reduced):
        losses = module(batch, step)
    # One transfer, so that a device waits for the processor once in a step.
    values = dict(zip(losses, torch.stack([*losses.values()]).detach().tolist(), strict=True))
    if not np.isfinite(values["loss"]):
        raise NeuGraspError(f"step {step}: the loss is {values['loss']}; the last state before it is kept")
    losses["loss"].backward()
    learner.update(config.optimiser.gradient_clip)
    return values


def _validate(this: _Run, step: int, records: TrainingLog) -> None:
    model, config, out = this.learner.smooth, this.config, this.run.out
    scores = this.spec.judge(model, this.held_out, config, step, out)
    records.validation(step, scores)
    about = _about(this.run, config, step, this.num_scenes)
    save_checkpoint(out / "weights.safetensors", model, about, network=config.network)
    log.info("step %d validation: %s", step, {name: round(value, 3) for name, value in scores.items()})


def _show_progress(step: int, config: TrainConfig, losses: dict[str, float], seconds: float) -> None:
    left = (config.steps - step) * seconds / 60
    terms = " ".join(f"{name} {value:.4f}" for name, value in losses.items())
    log.info("step %d / %d  %s  %.2f s a step, %.0f min left", step, config.steps, terms, seconds, left)


def _about(run: Train, config: TrainConfig, steps: int, scenes: int) -> dict[str, Any]:
    began = {"init": Path(run.init).name} if run.init else {}
    facts = {"recipe": run.recipe, **began, "steps": steps, "seed": config.seed, "scenes": scenes}
    return {**facts, "commit": source_commit()}
