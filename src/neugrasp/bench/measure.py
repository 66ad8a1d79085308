"""Product and reference in turns, so that what else happens on the machine happens to both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch

from neugrasp.bench.agreement import Agreement, agreement
from neugrasp.bench.command import SpeedTest
from neugrasp.bench.machine import Machine, Rates, measure_rates, peak_memory, this_machine
from neugrasp.bench.recorder import Cost
from neugrasp.bench.reference.network import ReferenceNetwork
from neugrasp.bench.reference.training import ReferenceTrainer
from neugrasp.bench.stages import (
    Loading,
    NewBackgrounds,
    ProductDetection,
    ReferenceDetection,
    Run,
    Subject,
    counted,
    timed,
)
from neugrasp.bench.subjects import (
    bundled_folder,
    bundled_views,
    shaped_detector,
    shaped_training,
    training_sample,
)
from neugrasp.bench.training_stages import ProductTrainer, Trainee, TrainingStep
from neugrasp.training.step import bfloat16_pays

WARM_UP = {"cpu": 0, "cuda": 3}
"""Passes that do not count, besides the one in which operations are counted."""


@dataclass(frozen=True)
class Series:
    """One way of doing something, several times."""

    runs: tuple[Run, ...]
    costs: dict[str, Cost]
    """Operations and bytes of the stages."""


@dataclass(frozen=True)
class Comparison:
    """The product and, unless it was left out, the reference."""

    product: Series
    reference: Series | None


@dataclass(frozen=True)
class Inference:
    """Photos to grasps."""

    stages: Comparison
    loading: Series
    """Reading the scene's files, which comes before."""
    new_backgrounds: Series
    """Encoding backgrounds that were not seen before, which comes once for every cell."""
    agreement: Agreement | None
    """Of the product with the reference, on this scene."""
    memory: int | None
    """Most bytes held by the process after detecting twice, before anything else."""


@dataclass(frozen=True)
class Training:
    """Training steps."""

    stages: Comparison
    kept: tuple[int, ...]
    """Bytes of activations that a step keeps for its backward pass: product, reference."""


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
        # In this order: only before the reference and the copied blocks is the peak memory the product's.
        inference = _inference(settings, device) if settings.part != "training" else None
        rates = measure_rates(device)
        training = _training(settings, device) if settings.part != "inference" else None
    finally:
        torch.set_num_threads(before)
    return Measurement(settings, machine, rates, inference, training)


def compare(
    product: Subject, reference: Subject | None, rounds: int, fuse: Callable[[], None] | None = None
) -> Comparison:
    """Both in turns, `rounds` times each, after a pass each in which operations are counted.

    `fuse` compiles parts of the product, once they are counted: inside them nothing could be.
    """
    subjects = [product] if reference is None else [product, reference]
    costs = [counted(subject).stages for subject in subjects]
    if fuse is not None:
        fuse()
        timed(product)
    for _ in range(WARM_UP[product.device.type]):
        for subject in subjects:
            timed(subject)
    rows = [[timed(subject) for subject in subjects] for _ in range(rounds)]
    series = [Series(tuple(runs), cost) for runs, cost in zip(zip(*rows, strict=True), costs, strict=True)]
    return Comparison(series[0], series[1] if reference is not None else None)


def _inference(settings: SpeedTest, device: torch.device) -> Inference:
    views = bundled_views(settings.views)
    detector = shaped_detector(settings.network, settings.seed, device)
    bfloat16 = settings.precision == "bfloat16"
    product = ProductDetection(detector, views, bfloat16)
    timed(product)
    timed(product)
    memory = peak_memory(device)
    reference = ReferenceDetection(detector, views) if settings.reference else None
    stages = compare(product, reference, settings.rounds)
    loading = compare(Loading(bundled_folder()), None, settings.rounds).product
    empty = compare(NewBackgrounds(detector, views, bfloat16), None, settings.rounds).product
    same = None
    if reference is not None and product.found is not None and reference.found is not None:
        same = agreement(product.found, reference.found, views.workspace, detector.gripper)
    return Inference(stages, loading, empty, same, memory)


def _training(settings: SpeedTest, device: torch.device) -> Training:
    model = shaped_detector(settings.network, settings.seed, device).model
    config = shaped_training(settings.network, model)
    own = config.bfloat16 and bfloat16_pays(device)
    config = replace(
        config, bfloat16=own if settings.precision == "own" else settings.precision == "bfloat16"
    )
    sample = training_sample(bundled_views(settings.views), config.model.image_size, settings.seed).to(device)
    trainees: list[Trainee] = [ProductTrainer(model, config)]
    if settings.reference:
        # Before the product's first step, so that both start from the same weights.
        trainees.append(ReferenceTrainer(ReferenceNetwork(model), config))
    steps = [TrainingStep(trainee, sample, settings.seed) for trainee in trainees]
    rounds = (settings.rounds + 1) // 2
    fuse = model.field.fuse if settings.compile else None
    stages = compare(steps[0], steps[1] if settings.reference else None, rounds, fuse)
    return Training(stages, tuple(step.kept for step in steps))
