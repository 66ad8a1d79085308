"""One look at held-out records: is the surface right, and does the best grasp hold when it is executed?

Every record is one attempt from the untouched scene: the best grasp of a detector is carried out in physics
under the paper's rule, contacts on the way allowed. Not the decluttering benchmark.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
import zlib
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.baselines.antipodal import antipodal_grasp
from neugrasp.data.records import Record
from neugrasp.detection.ask_head import predict_grasps
from neugrasp.detection.decode import select_grasps
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Validate
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.metrics import CONSTANTS, l1_by_mask, wilson_interval
from neugrasp.model.checkpoint import find_weights
from neugrasp.simulation.physics import World
from neugrasp.simulation.trials import execute
from neugrasp.training.samples import plain_sample
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
    """As `material_of` says."""
    detector: str
    num_grasps: int
    success: bool
    reason: str
    score: float


def material_of(record: Record) -> str:
    """The material set of a scene: "diffuse", "transparent-specular" (nothing diffuse in it) or "mixed"."""
    diffuse = [material == "diffuse" for material in record.materials]
    if all(diffuse):
        return "diffuse"
    return "mixed" if any(diffuse) else "transparent-specular"


def attempts_of(
    record: Record, detector: NeuGraspDetector, world: World, rng: np.random.Generator
) -> Iterator[Attempt]:
    """The best grasp of every detector, executed in the record's scene."""
    for name in DETECTORS:
        grasps = find_grasps(name, record, detector, rng)
        success, reason = False, "nothing detected"
        if grasps:
            world.reset(record.scene)
            trial = execute(world, grasps[0], rule="paper", allow_contact=True)
            success, reason = trial.success, trial.reason
        score = grasps[0].score if grasps else 0.0
        yield Attempt(
            record.name, record.kind, material_of(record), name, len(grasps), success, reason, score
        )


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


def oracle_grasps(tsdf: np.ndarray, detector: NeuGraspDetector) -> tuple[Grasp, ...]:
    """What the grasp head finds on a true TSDF (r, r, r) in [-1, 1]."""
    prediction = predict_grasps(detector.model.head, tsdf)
    return select_grasps(prediction, detector.model.workspace, detector.gripper, detector.selection).grasps


def run_held_out(run: Validate) -> dict[str, Any]:
    """Writes attempts.jsonl and held_out.json to `run.out` and returns what the latter holds.

    Goes on where it stopped: records that have their attempts already are not tried again. Raises
    `InputError` where `run.out` holds attempts of other weights or options.
    """
    from neugrasp.simulation.objects import ObjectLibrary

    records = _read_all(run.data)
    detector = NeuGraspDetector.load(
        run.weights, run.gripper, threshold=run.threshold, hand_check=run.hand_check
    )
    sets = sorted({body.object_set for record in records for body in record.scene.bodies})
    library = ObjectLibrary.open(sets, run.objects)
    run.out.mkdir(parents=True, exist_ok=True)
    facts = _describe(run, detector.selection.threshold)
    path = run.out / "attempts.jsonl"
    missing = [record for record in records if record.name not in _finished(path)]
    with World(Workspace(), library, detector.gripper) as world, path.open("a") as file:
        for index, record in enumerate(missing):
            rng = np.random.default_rng([run.seed, zlib.crc32(record.name.encode())])
            lines = [json.dumps(asdict(attempt)) for attempt in attempts_of(record, detector, world, rng)]
            file.write("".join(line + "\n" for line in lines))
            file.flush()
            if (index + 1) % 10 == 0:
                log.info("%d of %d records", index + 1, len(missing))
    summary = {**facts, **_summarise(records, detector, path)}
    (run.out / "held_out.json").write_text(json.dumps(summary, indent=1) + "\n")
    return summary


def _read_all(folders: tuple[Path, ...]) -> list[Record]:
    from neugrasp.training.dataset import read_records

    records = [record for folder in folders for record in read_records(folder)]
    counts = Counter(record.name for record in records)
    if doubled := [name for name, count in counts.items() if count > 1]:
        raise InputError(f"record {doubled[0]!r} is in two of the folders; names must differ")
    if not records:
        raise InputError("no records to validate on")
    return records


def _describe(run: Validate, threshold: float) -> dict[str, Any]:
    """What the attempts depend on besides the records: written to run.json or compared with it."""
    weights = find_weights(run.weights)
    facts = {
        "weights": weights.stem,
        "weights_sha256": hashlib.sha256(weights.read_bytes()).hexdigest(),
        "gripper": run.gripper,
        "threshold": threshold,
        "hand_check": run.hand_check,
        "seed": run.seed,
    }
    path = run.out / "run.json"
    if not path.is_file():
        path.write_text(json.dumps(facts, indent=1) + "\n")
    elif (found := json.loads(path.read_text())) != facts:
        other = next(key for key in facts if found.get(key) != facts[key])
        raise InputError(
            f"{run.out}: holds attempts with {other} = {found.get(other)!r}, not {facts[other]!r}; "
            "choose another --out"
        )
    return facts


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
    temporary = path.with_suffix(".tmp")
    temporary.write_text("".join(line + "\n" for line in kept))
    temporary.replace(path)
    return done


def _summarise(records: list[Record], detector: NeuGraspDetector, path: Path) -> dict[str, Any]:
    names = {record.name for record in records}
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for attempt in map(json.loads, path.read_text().splitlines()):
        if attempt["record"] in names:
            groups[f"{attempt['kind']}/{attempt['detector']}"].append(attempt)
    success = {name: _rate(group) for name, group in sorted(groups.items())}
    by_material: dict[str, list[Record]] = defaultdict(list)
    for record in records:
        by_material[material_of(record)].append(record)
    size = detector.model.config.image_size
    scores = {}
    for material, some in sorted(by_material.items()):
        samples = [plain_sample(record, Workspace(), size) for record in some]
        means = validate(detector.model, samples, 400.0) | _constants(some)
        # JSON has no NaN: what no record has, such as the AUC of labels that all failed, is null.
        defined = {name: value if math.isfinite(value) else None for name, value in means.items()}
        scores[material] = {"records": len(some), **defined}
    return {"records": len(records), "success": success, "by_material": scores}


def _constants(records: list[Record]) -> dict[str, float]:
    """The L1 of predictors that know nothing, under every mask."""
    errors: dict[str, list[float]] = defaultdict(list)
    for record in records:
        for constant in CONSTANTS:
            for mask, error in l1_by_mask(constant, record.tsdf).items():
                errors[f"l1_{mask}_constant_{constant:+.0f}"].append(error)
    return {name: float(np.mean(values)) for name, values in errors.items()}


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
