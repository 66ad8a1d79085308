"""Training on a GPU that can be had for some minutes only: several variants of a recipe beside each other.

    python benchmarks/gpu.py --data SHARDS ... --validation SHARDS ... --out DIR --minutes 8 VARIANT ...

Variants share the GPU, a process each; one alone takes more steps. Every process first takes
a few steps to see how long one takes beside the others, then trains for as many as fit into the minutes, so
that the learning rate has fallen when they are over. `DIR/VARIANT.safetensors` and `DIR/VARIANT.jsonl` are
written whenever a variant has been validated. `tests/gpu` (`pytest -m gpu`) is the smoke test to run before.
"""

from __future__ import annotations

import argparse
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import torch
from torch import multiprocessing

from neugrasp.training.command import Train
from neugrasp.training.config import TrainConfig
from neugrasp.training.recipes import RECIPES, sim
from neugrasp.training.trainer import train

TRIAL = 60
"""Steps to see how long one takes."""
PARTS = 4
"""How often a variant is validated and written."""


def sim_batch() -> TrainConfig:
    """`sim` with four scenes in a step."""
    return replace(sim(), batch=4, head_batch=4, bfloat16=False, validation_scenes=24)


def with_weights(**weights: float) -> Callable[[], TrainConfig]:
    """`sim_batch` with other weights of its losses."""
    return lambda: replace(sim_batch(), weights=replace(sim_batch().weights, **weights))


def from_random() -> TrainConfig:
    """`sim_batch` for random weights."""
    return replace(sim_batch(), optimiser=replace(sim().optimiser, learning_rate=2e-3))


def wider() -> TrainConfig:
    """`sim_batch` with half as many channels again, from random weights."""
    model = replace(
        sim().model, encoder_width=24, feature_dim=24, volume_dim=16, fusion_hidden=64, fused_dim=48,
        volume_hidden=(24, 24, 48, 64),
    )  # fmt: skip
    optimiser = replace(sim().optimiser, learning_rate=1.5e-3)
    return replace(sim_batch(), model=model, optimiser=optimiser)


VARIANTS: dict[str, tuple[Callable[[], TrainConfig], str | None]] = {
    "sim": (sim_batch, "neugrasp"),
    "sim-scratch": (from_random, None),
    "sim-occupancy": (with_weights(distance=0.5, occupancy=0.4), "neugrasp"),
    "sim-wider": (wider, None),
}
"""Configuration and the weights that it starts from."""


def run_variant(name: str, options: argparse.Namespace, until: float) -> None:
    """Trains one variant until the clock says so."""
    make, init = VARIANTS[name]
    folder = options.work / name
    shutil.rmtree(folder, ignore_errors=True)
    RECIPES[name] = make
    run = Train(
        recipe=name, data=tuple(options.data), validation=tuple(options.validation), out=folder / "trial",
        device=options.device, init=init, loaders=options.loaders, steps=TRIAL,
    )  # fmt: skip
    RECIPES[name] = lambda: replace(make(), checkpoint_every=TRIAL // 2, validation_scenes=0)
    train(run, stop_after=TRIAL // 2)
    began = time.monotonic()
    train(replace(run, resume=True))
    seconds = (time.monotonic() - began) / (TRIAL - TRIAL // 2)
    part = max(TRIAL, int(0.9 * (until - time.time()) / seconds)) // PARTS
    steps = PARTS * part
    print(f"{name}: {seconds * 1000:.0f} ms a step, {steps} steps", flush=True)
    RECIPES[name] = lambda: replace(make(), validate_every=part, checkpoint_every=part)
    run = replace(run, out=folder / "run", steps=steps)
    for done in range(PARTS):
        weights = train(replace(run, resume=done > 0), stop_after=part * (done + 1))
        shutil.copy(weights, options.out / f"{name}.safetensors")
        shutil.copy(run.out / "log.jsonl", options.out / f"{name}.jsonl")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("variants", nargs="*", default=list(VARIANTS), metavar="VARIANT")
    parser.add_argument("--data", nargs="+", type=Path, required=True)
    parser.add_argument("--validation", nargs="+", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--work", type=Path, default=Path("/tmp/gpu-runs"))
    parser.add_argument("--minutes", type=float, default=8.0)
    parser.add_argument(
        "--loaders", type=int, default=3, help="processes of each variant that prepare scenes"
    )
    parser.add_argument("--device", default="cuda")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    until = time.time() + 60 * options.minutes
    context = multiprocessing.get_context("spawn")
    running = [context.Process(target=run_variant, args=(name, options, until)) for name in options.variants]
    for process in running:
        process.start()
    for process in running:
        process.join()


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
