"""Stages of detecting and of training, timed several times each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from neugrasp.bench.command import SpeedTest
from neugrasp.bench.machine import Machine, Rates, measure_rates, peak_memory, this_machine
from neugrasp.bench.recorder import Cost
from neugrasp.bench.stages import Detecting, Loading, NewBackgrounds, Run, Workload, counted, timed
from neugrasp.bench.training_stages import TrainingStep
from neugrasp.bench.workloads import (
    bundled_folder,
    bundled_views,
    shaped_detector,
    shaped_training,
    training_sample,
)
from neugrasp.progress import counted as in_progress
from neugrasp.training.module import bfloat16_pays

WARM_UP = {"cpu": 0, "cuda": 3}
"""Passes that do not count, besides the one in which operations are counted."""


@dataclass(frozen=True)
class Series:
    """One way of doing something, several times."""

    runs: tuple[Run, ...]
    costs: dict[str, Cost]
    """Operations and bytes of the stages."""


@dataclass(frozen=True)
class Inference:
    """Photos to grasps."""

    stages: Series
    loading: Series
    """Reading the scene's files, which comes before."""
    new_backgrounds: Series
    """Encoding backgrounds that were not seen before, which comes once for every cell."""
    memory: int | None
    """Most bytes held by the process after detecting twice, before anything else."""


@dataclass(frozen=True)
class Training:
    """Training steps."""

    stages: Series
    kept: int
    """Bytes of activations that a step keeps for its backward pass."""


@dataclass(frozen=True)
class Measurement:
    """Everything that was found out."""

    settings: SpeedTest
    machine: Machine
    rates: Rates
    inference: Inference | None
    training: Training | None


def measure(settings: SpeedTest) -> Measurement:
    """Runs the benchmark; the number of threads is set for it and put back."""
    before = torch.get_num_threads()
    torch.set_num_threads(settings.threads or before)
    device = torch.device(settings.device)
    try:
        machine = this_machine(device)
        # In this order: only before the copied blocks is the peak memory the detector's.
        inference = _inference(settings, device) if settings.part != "training" else None
        rates = measure_rates(device)
        training = _training(settings, device) if settings.part != "inference" else None
    finally:
        torch.set_num_threads(before)
    return Measurement(settings, machine, rates, inference, training)


def series(workload: Workload, rounds: int) -> Series:
    """`rounds` passes, after one in which operations are counted."""
    costs = counted(workload).stages
    for _ in range(WARM_UP[workload.device.type]):
        timed(workload)
    return Series(tuple(timed(workload) for _ in in_progress(range(rounds), "rounds")), costs)


def _inference(settings: SpeedTest, device: torch.device) -> Inference:
    views = bundled_views(settings.views)
    detector = shaped_detector(settings.network, settings.seed, device)
    bfloat16 = settings.precision == "bfloat16"
    detecting = Detecting(detector, views, bfloat16)
    timed(detecting)
    timed(detecting)
    memory = peak_memory(device)
    return Inference(
        series(detecting, settings.rounds),
        series(Loading(bundled_folder()), settings.rounds),
        series(NewBackgrounds(detector, views, bfloat16), settings.rounds),
        memory,
    )


def _training(settings: SpeedTest, device: torch.device) -> Training:
    model = shaped_detector(settings.network, settings.seed, device).model
    config = shaped_training(settings.network, model)
    own = config.bfloat16 and bfloat16_pays(device)
    config = replace(
        config,
        bfloat16=own if settings.precision == "own" else settings.precision == "bfloat16",
        seed=settings.seed,
    )
    sample = training_sample(bundled_views(settings.views), config.model.image_size, settings.seed).to(device)
    step = TrainingStep(model, config, sample)
    found = series(step, (settings.rounds + 1) // 2)
    return Training(found, step.kept)
