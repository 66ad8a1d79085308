"""Teaches the evaluator of grasps: boxes around tried grasps in, whether they held out."""

from __future__ import annotations

import hashlib
import logging
import math
import zlib
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Float32, Int8
from scipy.spatial.transform import Rotation
from torch import Tensor

from neugrasp.data.lessons import Lesson, gripper_of, read_lesson
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import USUAL, Workspace
from neugrasp.long_runs import held, source_commit
from neugrasp.metrics import area_under_roc
from neugrasp.model.evaluator_file import load_evaluator, save_evaluator
from neugrasp.model.grasp_evaluator import BOX, SIDES, FineGrid, GraspEvaluator, boxes, mirrored, numbers
from neugrasp.terminal import next_step
from neugrasp.training.command import TrainEvaluator
from neugrasp.training.config import Optimiser
from neugrasp.training.log import TrainingLog
from neugrasp.training.state import Identity, Learner, read_state, save_state

log = logging.getLogger(__name__)

HELD_OUT = 8
"""About one scene of so many is kept aside, in whatever folder its name stands."""
BINS = 10
"""Of the reliability curve."""
CLIP = 1.0


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
    seed: int = 0

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


@dataclass(frozen=True)
class Seen:
    """Trials as the network sees them."""

    box: Int8[Tensor, "k 7 23 16"]
    """As `boxes` gives them."""
    of_up: Float[Tensor, "k 4"]
    """As `numbers` gives them."""
    success: Float[Tensor, " k"]
    """1 where it held, else 0."""
    free: Bool[np.ndarray, " k"]
    """Whether the hand got there without a collision."""


def seen_of(lessons: list[Lesson], workspace: Workspace) -> Seen:
    """All trials of some lessons."""
    box, of_up = [], []
    for lesson in lessons:
        poses = np.zeros((len(lesson), 4, 4), np.float32)
        if len(lesson):
            poses[:, :3, :3] = Rotation.from_quat(lesson.quaternions).as_matrix()
        poses[:, :3, 3], poses[:, 3, 3] = lesson.positions, 1
        told = torch.from_numpy(poses)
        of_up.append(numbers(told, workspace))
        here = torch.zeros(len(lesson), *BOX, dtype=torch.int8)
        for number, grid in enumerate(lesson.grids):
            where = torch.from_numpy(np.flatnonzero(lesson.seen == number))
            fine = FineGrid.of(torch.from_numpy(grid.astype(np.float32)), workspace)
            here[where] = boxes(fine, told[where])
        box.append(here)
    success = np.concatenate([lesson.success for lesson in lessons]).astype(np.float32)
    return Seen(
        torch.cat(box),
        torch.cat(of_up),
        torch.from_numpy(success),
        np.concatenate([lesson.free for lesson in lessons]),
    )


def run(options: TrainEvaluator) -> str:
    """`neugrasp train-evaluator`: how good it is on what was kept aside, the file, and what to do next.

    Raises `InputError` on fewer steps than one, and as `train_evaluator`.
    """
    if options.steps < 1:
        raise InputError(f"--steps {options.steps}: must be at least 1")
    config = EvaluatorConfig(steps=options.steps, seed=options.seed)
    weights = train_evaluator(
        EvaluatorRun(
            data=options.data, out=options.out, config=config, init=options.init, resume=options.resume
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
    files, gripper = _files(run.data), gripper_of(run.data)
    aside = [file for file in files if is_held_out(file)]
    torch.manual_seed(config.seed)
    model = load_evaluator(run.init).model().train() if run.init else _new(config)
    learner = Learner.of(model, config)
    digest = hashlib.sha256("\n".join(f"{f.parent.name}/{f.name}" for f in files).encode()).hexdigest()
    identity = Identity(config, digest, run.init and Path(run.init).name)
    with held(run.out, "train"):
        saved = read_state(run.out)
        start = saved.restore(learner, identity) if saved else 0
        last = min(config.steps, stop_after or config.steps)
        kept = [f for f in files if f not in aside]
        taught = seen_of([read_lesson(f) for f in kept], workspace)
        judged = seen_of([read_lesson(f) for f in aside], workspace)
        log.info("%d trials of %d files, %d kept aside", len(taught.success), len(kept), len(judged.success))
        if start < last:
            _steps(run, learner, identity, taught, judged, start, last)
        weights = run.out / "evaluator.safetensors"
        about = {
            "steps": last,
            "trials": len(taught.success),
            "files": len(kept),
            "commit": source_commit(),
            **gripper,
        }
        told = about | {"scores": judgement(learner.smooth, judged), "config": asdict(config)}
        save_evaluator(weights, learner.smooth.eval(), workspace, told)
    return weights


def is_held_out(file: Path) -> bool:
    """Whether the scene of that name is judged with, and never taught."""
    return zlib.crc32(file.stem.encode()) % HELD_OUT == 0


def _new(config: EvaluatorConfig) -> GraspEvaluator:
    return GraspEvaluator(config.widths, config.hidden)


def _files(folders: tuple[Path, ...]) -> list[Path]:
    files = [file for folder in folders for file in sorted(folder.glob("[!.]*.npz"))]
    aside = sum(map(is_held_out, files))
    if not 0 < aside < len(files):
        where = ", ".join(map(str, folders))
        raise InputError(f"{where}: {len(files)} lessons, {aside} of them to be kept aside; more are needed")
    return files


def _steps(
    run: EvaluatorRun,
    learner: Learner[GraspEvaluator],
    identity: Identity,
    taught: Seen,
    judged: Seen,
    start: int,
    last: int,
) -> None:
    config = run.config
    records = TrainingLog(run.out, start)
    weights = torch.from_numpy(np.where(taught.free, 1.0, config.weight_of_collisions)).float()
    try:
        for step in range(start, last):
            chosen = _batch(config, step, len(taught.success))
            rate = config.learning_rate_at(step)
            for group in learner.optimizer.param_groups:
                group["lr"] = rate
            loss = _loss(learner.model, taught, weights, chosen)
            loss.backward()
            learner.update(CLIP)
            records.step(step, {"loss": float(loss.detach())}, rate)
            done = step + 1
            if done % config.checkpoint_every == 0 or done == config.steps:
                scores = judgement(learner.smooth, judged)
                records.validation(done, scores)
                save_state(run.out, learner, done, identity)
                said = ", ".join(f"{name} {value:.3f}" for name, value in scores.items() if " " not in name)
                log.info("%d of %d steps: loss %.3f; %s", done, config.steps, float(loss.detach()), said)
    finally:
        records.close()


def _batch(config: EvaluatorConfig, step: int, count: int) -> Tensor:
    """Which trials a step sees: each once in every pass, in another order each time."""
    size = min(config.batch, count)
    per_pass = count // size
    order = np.random.default_rng([config.seed, step // per_pass]).permutation(count)
    place = (step % per_pass) * size
    return torch.from_numpy(order[place : place + size])


def _loss(model: GraspEvaluator, taught: Seen, weights: Tensor, chosen: Tensor) -> Tensor:
    """Cross-entropy; each quarter of the trials is seen in another mirror."""
    logits, parts = [], chosen.chunk(4)
    for (x, y), part in zip(SIDES, parts, strict=False):
        logits.append(model(*mirrored(taught.box[part], taught.of_up[part], x, y)))
    return F.binary_cross_entropy_with_logits(torch.cat(logits), taught.success[chosen], weights[chosen])


@torch.no_grad()
def probabilities(model: GraspEvaluator, seen: Seen, at_once: int = 1024) -> Float32[np.ndarray, " k"]:
    """What the network says of trials; the mean over mirror images."""
    was_training = model.training
    model.eval()
    parts = [
        model.symmetric(box, of_up)
        for box, of_up in zip(seen.box.split(at_once), seen.of_up.split(at_once), strict=True)
    ]
    model.train(was_training)
    found: np.ndarray = torch.cat(parts).sigmoid().numpy()
    return found


def judgement(model: GraspEvaluator, seen: Seen) -> dict[str, float]:
    """AUC over all trials and over those free of collision, the loss, and the reliability curve.

    The curve: of each bin of probability its trials, what was said, and what held; its error is the mean gap.
    """
    said, held_at_all = probabilities(model, seen), seen.success.numpy() > 0.5
    scores = {
        "auc": area_under_roc(said, held_at_all),
        "auc_free": area_under_roc(said[seen.free], held_at_all[seen.free]),
        "loss": float(F.binary_cross_entropy(torch.from_numpy(said), seen.success)),
    }
    gaps = 0.0
    bins = np.minimum((said * BINS).astype(int), BINS - 1)
    for number in range(BINS):
        here = bins == number
        if here.any():
            name = f"from {number / BINS:g}"
            scores |= {f"{name} trials": float(here.sum()), f"{name} said": float(said[here].mean())}
            scores[f"{name} held"] = float(held_at_all[here].mean())
            gaps += here.sum() * abs(scores[f"{name} said"] - scores[f"{name} held"])
    return scores | {"calibration_error": float(gaps / len(said))}


def reliability_table(weights: Path) -> str:
    """The scores noted with an evaluator, and its reliability curve, for people."""
    scores = load_evaluator(weights).about["scores"]
    lines = [f"{name:<18} {scores[name]:.3f}" for name in scores if " " not in name]
    lines += ["", "said            trials   said   held"]
    for number in range(BINS):
        name = f"from {number / BINS:g}"
        if f"{name} trials" in scores:
            count, said, held_share = (scores[f"{name} {what}"] for what in ("trials", "said", "held"))
            span = f"{number / BINS:g} to {(number + 1) / BINS:g}"
            lines.append(f"{span:<15} {count:>6.0f}  {said:>5.2f}  {held_share:>5.2f}")
    return "\n".join([*lines, "", f"{weights}"])
