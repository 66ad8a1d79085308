"""The training loop, readable from top to bottom."""

from __future__ import annotations

import logging
import os
import time
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from neugrasp.errors import InputError, NeuGraspError
from neugrasp.long_runs import held, source_commit
from neugrasp.model.checkpoint import save_checkpoint
from neugrasp.model.compute import Compute
from neugrasp.progress import reached
from neugrasp.terminal import next_step
from neugrasp.training.command import Train
from neugrasp.training.config import TrainConfig
from neugrasp.training.dataset import Batch, Scenes, Steps, identity_of, loader
from neugrasp.training.distributed import Ranks, joined_ranks
from neugrasp.training.early_stop import EarlyStop
from neugrasp.training.log import TrainingLog
from neugrasp.training.module import TrainingModule, bfloat16_pays
from neugrasp.training.networks import NetworkSpec, network_spec
from neugrasp.training.recipes import configured
from neugrasp.training.split import HeldOutScenes, open_data
from neugrasp.training.start import start_from
from neugrasp.training.state import Identity, Learner, read_state, save_state

log = logging.getLogger(__name__)


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
    spec = network_spec(config.network)
    scenes, held_out = open_data(run, config, spec)
    model: Any = spec.build(config.model, scenes.workspace)
    if run.init:
        start_from(model, run.init, config.network, spec)
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
        # Where training ends early, the weights of the best validation stay.
        if ranks.leads and not (config.patience and weights.is_file()):
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
    held_out: HeldOutScenes
    num_scenes: int


def _train(this: _Run, scenes: Scenes, start: int, last: int) -> None:
    """Steps `start` to `last`."""
    config, ranks, learner, out = this.config, this.ranks, this.learner, this.run.out
    module = ranks.wrap(TrainingModule(learner.model, this.spec.losses, config, ranks.rank))
    steps = Steps(scenes, config, ranks.rank, ranks.count)
    about = asdict(config) | {"recipe": this.run.recipe}
    records = TrainingLog(out, start, this.run.loggers, about) if ranks.leads else None
    early = EarlyStop(out / "log.jsonl", config.patience)
    began = time.monotonic()
    try:
        if ranks.agree(early.is_over):
            return
        for step, batch in enumerate(loader(steps, start, last, this.run.loaders), start):
            losses = _step(module, learner, batch.to(ranks.device), config, step)
            done = step + 1
            validates = this.held_out and (done % config.validate_every == 0 or done == config.steps)
            if records is not None:
                reached("steps", done, config.steps)
                records.step(step, losses, config.learning_rate_at(step))
                if validates:
                    _validate(this, done, records, early)
            is_over = config.patience > 0 and validates and ranks.agree(early.is_over)
            # The state comes last: a run killed before it validates again, one killed after it has done so.
            if records is not None and (
                done % config.checkpoint_every == 0 or done == config.steps or is_over
            ):
                save_state(out, learner, done, this.identity)
                _show_progress(done, config, losses, (time.monotonic() - began) / (done - start))
            if is_over:
                log.info(
                    "step %d: %d validations without a better one; the best one's weights are kept",
                    done,
                    config.patience,
                )
                break
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


def _validate(this: _Run, step: int, records: TrainingLog, early: EarlyStop) -> None:
    model, config, out = this.learner.smooth, this.config, this.run.out
    scores = this.spec.judge(model, this.held_out, config, step, out)
    records.validation(step, scores)
    if early.add(scores):
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
