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
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.baselines.antipodal import antipodal_grasp
from neugrasp.data.fields import Fields
from neugrasp.data.records import Record
from neugrasp.data.scene_sets import read_records
from neugrasp.data.strict_json import parse_json
from neugrasp.detection.decode import select_grasps
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.test_time_augmentation import predict_grasps
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import OneShot
from neugrasp.evaluation.one_shot_table import one_shot_table
from neugrasp.grasp import Grasp
from neugrasp.gripper import gripper_hash
from neugrasp.metrics import CONSTANTS, l1_by_mask, wilson_interval
from neugrasp.model.checkpoint import find_weights
from neugrasp.output import naming, write_text
from neugrasp.progress import counted
from neugrasp.run_folder import CONTENTS, check_run_config, lock_folder
from neugrasp.simulation.grasp_execution import execute
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World
from neugrasp.terminal import next_step
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
) -> Sequence[Grasp]:
    """Grasps of one of `DETECTORS`, best first, workspace frame."""
    if name == "neugrasp":
        return detector.detect(record.views()).grasps
    if name == "oracle":
        return oracle_grasps(record.tsdf, detector)
    found = antipodal_grasp(record.tsdf, record.workspace, detector.gripper, rng)
    return () if found is None else (found,)


def oracle_grasps(tsdf: np.ndarray, detector: NeuGraspDetector) -> tuple[Grasp, ...]:
    """What the grasp head finds on a true TSDF (r, r, r) in [-1, 1]."""
    prediction = predict_grasps(detector.model.head, tsdf)
    return select_grasps(prediction, detector.model.workspace, detector.gripper, detector.selection).grasps


def run(config: OneShot) -> str:
    """`neugrasp one-shot`: the table, and where the numbers are."""
    table = one_shot_table(run_one_shot(config))
    then = next_step("evaluate", "--weights", config.weights, "--out", f"{config.out}_rounds")
    return f"{table}\n\n{config.out / 'held_out.json'}\n{then}"


def run_one_shot(run: OneShot) -> dict[str, Any]:
    """Writes attempts.jsonl and held_out.json to `run.out` and returns what the latter holds.

    Goes on where it stopped: records that have their attempts already are not tried again. Raises
    `InputError` where `run.out` holds attempts of other weights or options.
    """
    records = _read_all(run.data)
    detector = NeuGraspDetector.of(DetectorOptions.of(run))
    sets = sorted({body.object_set for record in records for body in record.scene.bodies})
    library = ObjectLibrary.open(sets, run.objects)
    for record in records:
        if record.workspace.cube != detector.model.workspace.cube:
            raise InputError(
                f"{record.name}: is about {record.workspace.describe()}; the weights were trained for "
                f"{detector.model.workspace.describe()}"
            )
    facts = _describe(run, detector.selection.threshold)
    with lock_folder(run.out, "one-shot"):
        check_run_config(run.out / "run.json", facts, "validation", young=CONTENTS)
        path = run.out / "attempts.jsonl"
        _try_missing(run, records, detector, library)
        summary = {**facts, **_summarise(records, detector, path)}
        write_text(run.out / "held_out.json", json.dumps(summary, indent=1) + "\n")
    return summary


def _try_missing(
    run: OneShot, records: list[Record], detector: NeuGraspDetector, library: ObjectLibrary
) -> None:
    """Appends the attempts of records that have none yet."""
    path = run.out / "attempts.jsonl"
    finished = _finished(path)
    missing = [record for record in records if record.name not in finished]
    with (
        World(detector.model.workspace, library, detector.gripper) as world,
        path.open("a", encoding="utf-8") as file,
    ):
        for index, record in enumerate(counted(missing, "records")):
            rng = np.random.default_rng([run.seed, zlib.crc32(record.name.encode())])
            lines = [json.dumps(asdict(attempt)) for attempt in attempts_of(record, detector, world, rng)]
            with naming(path):
                file.write("".join(line + "\n" for line in lines))
                file.flush()
            if (index + 1) % 10 == 0:
                log.info("%d of %d records", index + 1, len(missing))


def _read_all(folders: tuple[Path, ...]) -> list[Record]:

    records = [record for folder in folders for record in read_records(folder)]
    counts = Counter(record.name for record in records)
    if doubled := [name for name, count in counts.items() if count > 1]:
        raise InputError(f"record {doubled[0]!r} is in two of the folders; names must differ")
    if not records:
        raise InputError("no records to try grasps in")
    if blind := [record.name for record in records if not record.has_photos]:
        raise InputError(
            f"{len(blind)} of {len(records)} scenes have no photos, {blind[0]} among them; a detector needs "
            "some: `neugrasp generate` without --no-photos"
        )
    return records


def _describe(run: OneShot, threshold: float) -> dict[str, Any]:
    """What the attempts depend on besides the records."""
    weights = find_weights(run.weights)
    return {
        "weights": weights.stem,
        "weights_sha256": hashlib.sha256(weights.read_bytes()).hexdigest(),
        "gripper": run.gripper,
        "gripper_sha256": gripper_hash(run.gripper),
        "threshold": threshold,
        "hand_check": run.hand_check,
        "seed": run.seed,
    }


def _finished(path: Path) -> set[str]:
    """Records with an attempt of every detector; incomplete ones are dropped from the file."""
    if not path.is_file():
        return set()
    lines = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        with suppress(InputError):
            fields = Fields(str(path), parse_json(line, str(path)))
            for word in ("record", "kind", "detector", "reason"):
                fields.text(word)
            fields.flag("success")
            lines.append(fields.data)
    counts = Counter(line["record"] for line in lines)
    done = {name for name, count in counts.items() if count == len(DETECTORS)}
    kept = [json.dumps(line) for line in lines if line["record"] in done]
    write_text(path, "".join(line + "\n" for line in kept))
    return done


def _summarise(records: list[Record], detector: NeuGraspDetector, path: Path) -> dict[str, Any]:
    names = {record.name for record in records}
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for attempt in map(json.loads, path.read_text(encoding="utf-8").splitlines()):
        if attempt["record"] in names:
            groups[f"{attempt['kind']}/{attempt['detector']}"].append(attempt)
    success = {name: _rate(group) for name, group in sorted(groups.items())}
    by_material: dict[str, list[Record]] = defaultdict(list)
    for record in records:
        by_material[material_of(record)].append(record)
    size = detector.model.config.image_size
    scores = {}
    for material, some in sorted(by_material.items()):
        samples = [plain_sample(record.grasp_scene(), size) for record in some]
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
