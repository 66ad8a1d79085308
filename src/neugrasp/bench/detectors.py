"""Seconds from photos, or depth, to grasps of every detector that is registered here."""

from __future__ import annotations

import logging
import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch

from neugrasp.bench.command import SpeedTest
from neugrasp.bench.machine import Machine, this_machine
from neugrasp.bench.workloads import bundled_folder, bundled_views
from neugrasp.data.truth_file import truth_from_bytes
from neugrasp.detection.contract import Detection
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import TRUTH, detector_spec, registered
from neugrasp.errors import NeuGraspError
from neugrasp.evaluation.compared_methods import GivenWeights, compared_method
from neugrasp.observation import CHANNELS, Frame, Observation
from neugrasp.progress import counted
from neugrasp.run_folder import source_commit

log = logging.getLogger(__name__)

PATIENCE_S = 10.0
"""A detector that takes longer is timed once."""
LINE = "{:<20}{:>10}{:>9}  {:<28}{}"


@dataclass(frozen=True)
class Timing:
    """What one detector took."""

    detector: str
    sees: tuple[str, ...]
    seconds: tuple[float, ...]
    """Seconds of each detection after the first."""
    stages: dict[str, float]
    """Seconds of the last one by stage, as the detector tells them."""
    grasps: int
    paper_s: float | None
    problem: str = ""
    """Why it could not be timed."""


def time_detectors(settings: SpeedTest) -> tuple[Machine, list[Timing]]:
    """Every detector that sees no truth, on the first bundled scene: photos, empty table and exact depth."""
    before = torch.get_num_threads()
    torch.set_num_threads(settings.threads or before)
    given, seen = GivenWeights(settings.weights), _scene(settings.views)
    try:
        machine = this_machine(torch.device(settings.device))
        specs = {name: detector_spec(name) for name in settings.only or registered()}
        names = [name for name, spec in specs.items() if spec.observes != TRUTH]
        return machine, [_timed(name, settings, given, seen) for name in counted(names, "detectors")]
    finally:
        torch.set_num_threads(before)


def _timed(name: str, settings: SpeedTest, given: GivenWeights, seen: Observation) -> Timing:
    spec = detector_spec(name)
    sees = tuple(channel for channel in CHANNELS if channel in spec.observes)
    nothing = Timing(name, sees, (), {}, 0, compared_method(name).paper_s)
    options = DetectorOptions(
        weights=given.of(name), restorer=settings.restorer, device=settings.device, seed=settings.seed
    )
    frames = [{channel: getattr(frame, channel) for channel in sees} for frame in seen.frames]
    asked = replace(
        seen, frames=tuple(Frame(old.camera, **new) for old, new in zip(seen.frames, frames, strict=True))
    )
    try:
        detector = spec.load(options)
        seconds, found = [], None
        for _ in range(1 + settings.rounds):
            start = time.perf_counter()
            found = detector.detect(asked)
            seconds.append(time.perf_counter() - start)
            if seconds[0] > PATIENCE_S:
                break
    except NeuGraspError as error:
        log.warning("%s: %s", name, error)
        return replace(nothing, problem=str(error))
    assert isinstance(found, Detection)
    counted_ones = tuple(seconds[1:] or seconds)
    return replace(nothing, seconds=counted_ones, stages=dict(found.timing_s), grasps=len(found.grasps))


def _scene(num: int) -> Observation:
    views, file = bundled_views(num), bundled_folder() / "truth.npz"
    depths = truth_from_bytes(file.read_bytes(), str(file))["depths"]
    frames = tuple(replace(view, depth=depths[i % len(depths)]) for i, view in enumerate(views.frames))
    return Observation(frames, views.workspace, views.source)


def timings_table(machine: Machine, timings: Sequence[Timing]) -> str:
    """For reading in a terminal."""
    return "\n".join(_lines(machine, timings))


def _lines(machine: Machine, timings: Sequence[Timing]) -> Iterator[str]:
    yield f"{machine.processor}, {machine.cores} cores, {machine.threads} threads, on {machine.device}"
    if machine.is_busy:
        yield f"others computed here, too (load {machine.load:.1f}): these are upper bounds"
    yield ""
    yield LINE.format("photos to grasps", "seconds", "paper", "sees", "by stage")
    for one in timings:
        paper = "" if one.paper_s is None else f"{one.paper_s:g}"
        if one.problem:
            yield LINE.format(one.detector, "-", paper, ", ".join(one.sees), one.problem)
            continue
        stages = ", ".join(f"{name} {seconds:.2f}" for name, seconds in one.stages.items())
        median = f"{statistics.median(one.seconds):.3f}"
        yield LINE.format(one.detector, median, paper, ", ".join(one.sees), stages)
    yield ""
    yield "paper: on one GPU (RTX 4090D); NeuGrasp's is the forward pass of its network alone"


def timings_report(settings: SpeedTest, machine: Machine, timings: Sequence[Timing]) -> dict[str, Any]:
    """Everything as plain data."""
    return {
        "format": "neugrasp-bench-detectors",
        "version": 1,
        "command": settings.command(),
        "commit": source_commit(),
        "machine": vars(machine),
        "detectors": [vars(one) for one in timings],
    }
