"""Teaches the evaluator of grasps: boxes around tried grasps in, whether they held out."""

from __future__ import annotations

import hashlib
import json
import logging
import math
import zlib
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from neugrasp.data.lessons import gripper_of, read_lesson
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import USUAL
from neugrasp.model.compute import Compute
from neugrasp.model.evaluator_file import load_evaluator, save_evaluator
from neugrasp.model.grasp_evaluator import SIDES, GraspEvaluator, mirrored
from neugrasp.run_folder import lock_folder, source_commit
from neugrasp.terminal import next_step
from neugrasp.training.command import TrainEvaluator
from neugrasp.training.config import Optimiser
from neugrasp.training.distributed import Ranks
from neugrasp.training.evaluator_scores import judgement, reliability_table
from neugrasp.training.evaluator_trials import TrialBatch, TrialSteps, seen_of
from neugrasp.training.loop import Course, follow
from neugrasp.training.state import Identity, TrainState, read_state

log = logging.getLogger(__name__)

HELD_OUT = 8
"""About one scene of so many is kept aside, in whatever folder its name stands."""


@dataclass(frozen=True, kw_only=True)
class EvaluatorConfig:
    """Everything a run depends on, besides its data."""

    steps: int = 5_000
    batch: int = 256
    widths: tuple[int, int, int] = (32, 48, 64)
    hidden: int = 64
    weight_of_collisions: float = 1.0
    optimiser: Optimiser = field(default_factory=lambda: Optimiser(learning_rate=1.5e-3, average=0.998))
    checkpoint_every: int = 500
    validate_every: int = 500
    seed: int = 0
    bfloat16: bool = False
    patience: int = 0

    def learning_rate_at(self, step: int) -> float:
        """A short rise, then half a cosine down to a hundredth."""
        warm = min(1.0, (step + 1) / min(100, 1 + self.steps // 10))
        cosine = 0.5 + 0.5 * math.cos(math.pi * step / self.steps)
        return self.optimiser.learning_rate * warm * max(0.01, cosine)


@dataclass(frozen=True, kw_only=True)
class EvaluatorRun:
    """Where a run reads and writes."""

    data: tuple[Path, ...]
    """Folders of lessons (`data/lessons.py`)."""
    out: Path
    config: EvaluatorConfig = field(default_factory=EvaluatorConfig)
    init: str | None = None
    """An evaluator to start from, by name or file."""
    resume: bool = False
    device: str = "cpu"


def run(options: TrainEvaluator) -> str:
    """`neugrasp train-evaluator`: how good it is on what was kept aside, the file, and what to do next.

    Raises `InputError` on fewer steps than one, and as `train_evaluator`.
    """
    if options.steps < 1:
        raise InputError(f"--steps {options.steps}: must be at least 1")
    config = EvaluatorConfig(steps=options.steps, seed=options.seed)
    weights = train_evaluator(
        EvaluatorRun(
            data=options.data,
            out=options.out,
            config=config,
            init=options.init,
            resume=options.resume,
            device=options.device,
        )
    )
    then = ("--detector", "oracle-evaluator", "--evaluator", weights, "--out", weights.parent / "rounds")
    return f"{reliability_table(weights)}\n{next_step('evaluate', *then)}"


def train_evaluator(run: EvaluatorRun, stop_after: int | None = None) -> Path:
    """Trains and gives the path of the weights; `stop_after` ends early, as an interruption would.

    Raises `InputError` where data or an earlier run in `out` do not fit.
    """
    config, workspace = run.config, USUAL
    if any(run.out.glob("*.safetensors")) and not run.resume:
        raise InputError(f"{run.out}: holds an earlier run; add --resume to go on with it, or another --out")
    files = _files(run.data)
    grippers = {folder: gripper_of(folder) for folder in run.data}
    aside = [file for file in files if is_held_out(file)]
    torch.manual_seed(config.seed)
    device = Compute.of(run.device).device
    model = load_evaluator(run.init).model() if run.init else GraspEvaluator(config.widths, config.hidden)
    model.to(device).train()
    learner = TrainState.of(model, config)
    contents = [(f.parent.name, f.name, f.stat().st_size) for f in files]
    tried_with = [json.dumps(gripper.to_dict()) for gripper in grippers.values()]
    digest = hashlib.sha256(repr((contents, tried_with)).encode()).hexdigest()
    identity = Identity(config, digest, run.init and Path(run.init).name)
    with lock_folder(run.out, "train"):
        saved = read_state(run.out)
        start = saved.restore(learner, identity) if saved else 0
        last = min(config.steps, stop_after or config.steps)
        kept = [f for f in files if f not in aside]
        taught = seen_of([(read_lesson(f), grippers[f.parent]) for f in kept], workspace)
        judged = seen_of([(read_lesson(f), grippers[f.parent]) for f in aside], workspace)
        log.info("%d trials of %d files, %d kept aside", len(taught.success), len(kept), len(judged.success))
        weights, names = run.out / "evaluator.safetensors", sorted({one.name for one in grippers.values()})

        def keep(step: int, scores: dict[str, float]) -> None:
            about = {"steps": step, "trials": len(taught.success), "files": len(kept), "grippers": names}
            told = about | {"commit": source_commit(), "scores": scores, "config": asdict(config)}
            save_evaluator(weights, learner.smooth, workspace, told)

        course = Course(
            out=run.out,
            config=config,
            learner=learner,
            losses=EvaluatorLoss(model),
            batches=TrialSteps(taught, config),
            identity=identity,
            ranks=Ranks(device),
            judge=lambda network, _step: judgement(network, judged),
            keep=keep,
        )
        if start < last:
            follow(course, start, last)
        if start >= last or last < config.steps:
            # Else the last validation has just done so.
            keep(last, judgement(learner.smooth, judged))
    return weights


def is_held_out(file: Path) -> bool:
    """Whether the scene of that name is judged with, and never taught."""
    return zlib.crc32(file.stem.encode()) % HELD_OUT == 0


def _files(folders: tuple[Path, ...]) -> list[Path]:
    files = [file for folder in folders for file in sorted(folder.glob("[!.]*.npz"))]
    aside = sum(map(is_held_out, files))
    if not 0 < aside < len(files):
        where = ", ".join(map(str, folders))
        raise InputError(f"{where}: {len(files)} lessons, {aside} of them to be kept aside; more are needed")
    return files


class EvaluatorLoss(nn.Module):
    """Cross-entropy; each quarter of the trials is seen in another mirror."""

    def __init__(self, model: GraspEvaluator):
        super().__init__()
        self.model = model

    def forward(self, trials: TrialBatch, _step: int) -> dict[str, Tensor]:
        """The loss of a step, as the training loop wants it."""
        quarters = torch.arange(len(trials.box)).chunk(4)
        logits = [
            self.model(
                *mirrored(trials.box[some], trials.of_up[some], x, y), trials.hand[some].mirrored(x, y)
            )
            for (x, y), some in zip(SIDES, quarters, strict=False)
        ]
        return {"loss": F.binary_cross_entropy_with_logits(torch.cat(logits), trials.success, trials.weights)}
