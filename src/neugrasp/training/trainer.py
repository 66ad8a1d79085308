"""`neugrasp train`: data, network and weights of a run, for the training loop (`training/loop.py`)."""

from __future__ import annotations

import logging
import os
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch

from neugrasp.errors import InputError, NeuGraspError
from neugrasp.model.checkpoint import save_checkpoint
from neugrasp.model.compute import Compute
from neugrasp.run_folder import lock_folder, source_commit
from neugrasp.terminal import next_step
from neugrasp.training.command import Train
from neugrasp.training.config import TrainConfig
from neugrasp.training.dataset import Steps, identity_of
from neugrasp.training.distributed import joined_ranks
from neugrasp.training.loop import Course, follow
from neugrasp.training.module import TrainingModule, bfloat16_pays
from neugrasp.training.networks import network_spec
from neugrasp.training.recipes import configured
from neugrasp.training.split import open_data
from neugrasp.training.start import start_from
from neugrasp.training.state import Identity, TrainState, read_state

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
    with lock_folder(run.out, "train") if leads else nullcontext():
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
        learner = TrainState.of(model, config)
        identity = Identity(config, identity_of(scenes), run.init and Path(run.init).name)
        start = saved.restore(learner, identity) if saved else 0
        last = min(config.steps, stop_after or config.steps)
        weights = run.out / "weights.safetensors"

        def judge(network: Any, step: int) -> dict[str, float]:
            return spec.judge(network, held_out, config, step, run.out)

        def keep(step: int, _scores: dict[str, float] | None = None) -> None:
            about = _about(run, config, step, len(scenes))
            save_checkpoint(weights, learner.smooth, about, network=config.network)

        course = Course(
            out=run.out,
            config=config,
            learner=learner,
            losses=TrainingModule(model, spec.losses, config, ranks.rank),
            batches=Steps(scenes, config, ranks.rank, ranks.count),
            identity=identity,
            ranks=ranks,
            judge=judge if held_out else None,
            keep=keep,
            loaders=run.loaders,
            loggers=run.loggers,
            about=asdict(config) | {"recipe": run.recipe},
        )
        if start < last:
            follow(course, start, last)
        # Where training ends early, the weights of the best validation stay.
        if ranks.leads and not (config.patience and weights.is_file()):
            keep(last)
    return weights


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


def _about(run: Train, config: TrainConfig, steps: int, scenes: int) -> dict[str, Any]:
    began = {"init": Path(run.init).name} if run.init else {}
    facts = {"recipe": run.recipe, **began, "steps": steps, "seed": config.seed, "scenes": scenes}
    return {**facts, "commit": source_commit()}
