"""One look at held-out records: is the surface right, and does the best grasp hold when it is executed?

Every record is one attempt from the untouched scene: the best grasp of a detector is carried out in physics
under the paper's rule, contacts on the way allowed. Not the decluttering benchmark.
"""

from __future__ import annotations

import json
import logging
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from neugrasp.baselines.antipodal import antipodal_grasp
from neugrasp.data.records import Record
from neugrasp.detection.decode import Prediction, SelectionConfig, select_grasps
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.metrics import wilson_interval
from neugrasp.simulation.physics import World
from neugrasp.simulation.trials import execute
from neugrasp.training.samples import prepare_record, sample_of
from neugrasp.training.validation import validate

log = logging.getLogger(__name__)

DETECTORS = ("neugrasp", "oracle", "antipodal")
"""The network; its own grasp head on the true TSDF; random antipodal candidates on the true TSDF."""


@dataclass(frozen=True)
class Attempt:
    """One line of attempts.jsonl."""

    record: str
    kind: str
    materials: str
    """The material of all bodies, or "mixed"."""
    detector: str
    num_grasps: int
    success: bool
    reason: str
    score: float


def attempts_of(
    record: Record, detector: NeuGraspDetector, world: World, rng: np.random.Generator
) -> Iterator[Attempt]:
    """The best grasp of every detector, executed in the record's scene."""
    kinds = set(record.materials)
    material = kinds.pop() if len(kinds) == 1 else "mixed"
    for name in DETECTORS:
        grasps = find_grasps(name, record, detector, rng)
        success, reason = False, "nothing detected"
        if grasps:
            world.reset(record.scene)
            trial = execute(world, grasps[0], rule="paper", allow_contact=True)
            success, reason = trial.success, trial.reason
        score = grasps[0].score if grasps else 0.0
        yield Attempt(record.name, record.kind, material, name, len(grasps), success, reason, score)


def find_grasps(
    name: str, record: Record, detector: NeuGraspDetector, rng: np.random.Generator
) -> tuple[Grasp, ...]:
    """Grasps of one of `DETECTORS`, best first, workspace frame."""
    if name == "neugrasp":
        return detector.detect(record.views()).grasps
    if name == "oracle":
        return oracle_grasps(record.tsdf, detector)
    found = antipodal_grasp(record.tsdf, Workspace(), detector.gripper, rng)
    return () if found is None else (found,)


@torch.no_grad()
def oracle_grasps(tsdf: np.ndarray, detector: NeuGraspDetector) -> tuple[Grasp, ...]:
    """What the grasp head finds on a true TSDF (r, r, r) in [-1, 1]."""
    volume = detector.model.head(torch.from_numpy(tsdf).float().unsqueeze(0))
    prediction = Prediction(
        tsdf, volume.quality[0].numpy(), volume.rotation[0].numpy(), volume.width[0].numpy()
    )
    return select_grasps(prediction, detector.model.workspace, detector.gripper, detector.selection).grasps


@dataclass(frozen=True, kw_only=True)
class HeldOutRun:
    """What to look at and where to write."""

    data: tuple[Path, ...]
    out: Path
    weights: str = "neugrasp"
    gripper: str = "panda"
    objects: Path | None = None
    threshold: float = SelectionConfig().threshold
    seed: int = 0


def run_held_out(run: HeldOutRun) -> dict[str, Any]:
    """Writes attempts.jsonl and held_out.json to `run.out` and returns what the latter holds.

    Goes on where it stopped: records that have their attempts already are not tried again.
    """
    from neugrasp.simulation.objects import ObjectLibrary
    from neugrasp.training.data import read_records

    records = [record for folder in run.data for record in read_records(folder)]
    if not records:
        raise InputError("no records to validate on")
    detector = NeuGraspDetector.load(run.weights, run.gripper, threshold=run.threshold)
    run.out.mkdir(parents=True, exist_ok=True)
    path = run.out / "attempts.jsonl"
    done = _finished(path)
    sets = sorted({body.object_set for record in records for body in record.scene.bodies})
    library = ObjectLibrary.open(sets, run.objects)
    with World(Workspace(), library, detector.gripper) as world, path.open("a") as file:
        for index, record in enumerate(records):
            if record.name in done:
                continue
            rng = np.random.default_rng([run.seed, index])
            lines = [json.dumps(asdict(attempt)) for attempt in attempts_of(record, detector, world, rng)]
            file.write("".join(line + "\n" for line in lines))
            file.flush()
            if (index + 1) % 10 == 0:
                log.info("%d of %d records", index + 1, len(records))
    return _summarise(run, records, detector, path)


def _finished(path: Path) -> set[str]:
    """Records with an attempt of every detector; incomplete ones are dropped from the file."""
    if not path.is_file():
        return set()
    lines = []
    for line in path.read_text().splitlines():
        try:
            lines.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    counts = Counter(line["record"] for line in lines)
    done = {name for name, count in counts.items() if count == len(DETECTORS)}
    kept = [json.dumps(line) for line in lines if line["record"] in done]
    path.write_text("".join(line + "\n" for line in kept))
    return done


def _summarise(
    run: HeldOutRun, records: list[Record], detector: NeuGraspDetector, path: Path
) -> dict[str, Any]:
    attempts = [json.loads(line) for line in path.read_text().splitlines()]
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for attempt in attempts:
        groups[f"{attempt['kind']}/{attempt['detector']}"].append(attempt)
    success = {name: _rate(group) for name, group in sorted(groups.items())}
    by_material: dict[str, list[Record]] = defaultdict(list)
    for record in records:
        kinds = set(record.materials)
        by_material[kinds.pop() if len(kinds) == 1 else "mixed"].append(record)
    size = detector.model.config.image_size
    scores = {}
    for material, some in sorted(by_material.items()):
        samples = [sample_of(prepare_record(record), Workspace(), size, None) for record in some]
        scores[material] = {"records": len(some), **validate(detector.model, samples, 400.0)}
    summary = {"weights": run.weights, "threshold": run.threshold, "success": success, "by_material": scores}
    (run.out / "held_out.json").write_text(json.dumps(summary, indent=1) + "\n")
    return summary


def _rate(group: list[dict[str, Any]]) -> dict[str, Any]:
    successes = sum(attempt["success"] for attempt in group)
    low, high = wilson_interval(successes, len(group))
    return {
        "attempts": len(group),
        "successes": successes,
        "rate": round(100 * successes / len(group), 1),
        "ci": [round(100 * low, 1), round(100 * high, 1)],
        "reasons": dict(Counter(attempt["reason"] for attempt in group)),
    }
