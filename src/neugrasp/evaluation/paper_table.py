"""The paper's tables: every row played or gone on with, then written with the paper's figures beside ours."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from neugrasp.detection.registry import DetectorSpec, detector_spec
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate, Table
from neugrasp.evaluation.compare import compare
from neugrasp.evaluation.compared_methods import (
    COMPARED_METHODS,
    PAPER,
    ComparedMethod,
    GivenWeights,
    compared_method,
)
from neugrasp.evaluation.run import evaluate
from neugrasp.evaluation.surfaces import write_surfaces
from neugrasp.evaluation.tables import l1_cell, rate_cell
from neugrasp.evaluation.workers import MakeSceneRenderer
from neugrasp.output import write_text
from neugrasp.progress import counted
from neugrasp.run_folder import lock_folder
from neugrasp.terminal import next_step

log = logging.getLogger(__name__)

MATERIALS = ("transparent-specular", "diffuse")
STRATEGIES = ("random", "top")
FORMAT, VERSION = "neugrasp-table", 1
HEADS = (
    "system",
    "SR",
    "FSR",
    "DR",
    "L1",
    "rounds",
    "paper: SR / FSR / DR / L1",
    "SR less neugrasp's",
    "DR less neugrasp's",
    "s a round",
)


@dataclass(frozen=True)
class Row:
    """One evaluation of the table."""

    system: ComparedMethod
    evaluation: Evaluate

    @property
    def key(self) -> tuple[str, str, str, str]:
        """The key of `PAPER`."""
        asked = self.evaluation
        return asked.detector, asked.scene, asked.materials, asked.strategy


def run(config: Table, make_scene_renderer: MakeSceneRenderer | None = None) -> str:
    """`neugrasp table`: the table, or the name of the picture, and what to do next."""
    rows, left_out = planned(config)
    for name, reason in left_out.items():
        log.warning("%s is left out: %s", name, reason)
    if config.picture:
        picture = config.out / f"{config.scene}_surfaces.png"
        write_surfaces(picture, [row.evaluation for row in _first_of_each(rows)], make_scene_renderer)
        return f"{picture}\n{next_step('table', config.scene, '--out', config.out)}"
    page = config.out / f"{config.scene}.md"
    with lock_folder(config.out, "table"):
        done: list[tuple[Row, dict[str, Any]]] = []
        for row in counted(rows, "rows"):
            log.info("row %d of %d: %s, %s, strategy %s", len(done) + 1, len(rows), *_words(row))
            done.append((row, evaluate(row.evaluation, make_scene_renderer)))
            _write(page, config, done, left_out)
    worst = rows[-1].evaluation.out
    then = next_step("failures", worst, *([] if config.objects is None else ["--objects", config.objects]))
    return f"{page.read_text(encoding='utf-8')}\n{page}\n{then}"


def _words(row: Row) -> tuple[str, str, str]:
    asked = row.evaluation
    return row.system.title, asked.materials, asked.strategy


def planned(config: Table) -> tuple[list[Row], dict[str, str]]:
    """The rows in the order in which they are played, and why detectors are left out.

    Raises `InputError` where a detector that was asked for by name cannot be used, and where none can.
    """
    given = GivenWeights(config.weights)
    systems, left_out = [], {}
    for name in config.detectors or COMPARED_METHODS:
        asked = _evaluation(config, compared_method(name), given, MATERIALS[0], STRATEGIES[0])
        try:
            detector_spec(name).facts(asked.options())
            systems.append(compared_method(name))
        except InputError as error:
            if config.detectors:
                raise
            left_out[name] = str(error)
    if not systems:
        raise InputError(f"no detector can be used; the first says: {next(iter(left_out.values()))}")
    rows = [
        Row(system, _evaluation(config, system, given, materials, strategy))
        for strategy in config.strategies
        for materials in MATERIALS
        for system in systems
    ]
    return rows, left_out


def _evaluation(
    config: Table, system: ComparedMethod, given: GivenWeights, materials: Any, strategy: Any
) -> Evaluate:
    name = system.detector.replace(":", "-")
    spec = detector_spec(system.detector)
    return Evaluate(
        out=config.out / config.scene / f"{name}_{materials}_{strategy}",
        detector=system.detector,
        scene=config.scene,
        materials=materials,
        strategy=strategy,
        rounds=_rounds(config, system),
        weights=given.of(system.detector),
        restorer=config.restorer,
        objects=config.objects,
        seed=config.seed,
        workers=config.workers,
        cluster=config.cluster,
        device=config.device,
        **_sensors(config, system, spec),
    )


def _rounds(config: Table, system: ComparedMethod) -> int | None:
    limits = [number for number in (config.rounds, system.most_rounds) if number is not None]
    return min(limits, default=None)


def _sensors(config: Table, system: ComparedMethod, spec: DetectorSpec) -> dict[str, Any]:
    photos = {"samples": config.samples} if "image" in spec.observes else {}
    return {**photos, **({"depth": system.depth} if "depth" in spec.observes else {})}


def _first_of_each(rows: list[Row]) -> list[Row]:
    return list({row.system.detector: row for row in reversed(rows)}.values())[::-1]


def _write(
    page: Path, config: Table, done: list[tuple[Row, dict[str, Any]]], left_out: dict[str, str]
) -> None:
    """The page of the rows so far, and the same as JSON."""
    differences = [_against_ours(row, done) for row, _ in done]
    lines = [*_head(config), *_tables(done, differences), *_origins(done)]
    lines += [f"- {name} is left out: {reason}" for name, reason in left_out.items()]
    rows = [
        {**metrics, "paper": PAPER.get(row.key), "against_neugrasp": difference}
        for (row, metrics), difference in zip(done, differences, strict=True)
    ]
    told = {"format": FORMAT, "version": VERSION, "scene": config.scene, "rows": rows, "left_out": left_out}
    write_text(page.with_suffix(".json"), json.dumps(told, indent=1) + "\n")
    write_text(page, "\n".join(lines) + "\n")


def _against_ours(row: Row, done: list[tuple[Row, dict[str, Any]]]) -> dict[str, Any] | None:
    """`compare` with neugrasp's row of the same rounds; None for that row itself, or without one."""
    for other, _ in done:
        if other.key == ("neugrasp", *row.key[1:]) and other is not row:
            try:
                return compare(other.evaluation.out, row.evaluation.out)
            except InputError as error:
                log.warning("%s", error)
    return None


def _head(config: Table) -> Iterator[str]:
    yield f"# {config.scene.capitalize()} scenes: every system on the same rounds"
    yield ""
    yield (
        "Rates in percent with their 95 % intervals: Wilson for SR and FSR, a bootstrap over rounds for DR. "
        "Differences are paired by round, in points, with 95 % intervals and p. L1 as in the paper, under "
        "the mask 0.3, with that of a constant grid of 0 beside it. "
        "The paper's figures are of other rooms and materials."
    )
    yield ""


def _tables(
    done: list[tuple[Row, dict[str, Any]]], differences: list[dict[str, Any] | None]
) -> Iterator[str]:
    """A table for each set of materials and strategy."""
    for part in dict.fromkeys(row.key[2:] for row, _ in done):
        materials, strategy = part
        yield f"## {materials}, strategy `{strategy}`"
        yield ""
        yield "| " + " | ".join(HEADS) + " |"
        yield "|" + "---|" * len(HEADS)
        for (row, metrics), difference in zip(done, differences, strict=True):
            if row.key[2:] == part:
                yield "| " + " | ".join(_cells(row, metrics, difference)) + " |"
        yield ""


def _cells(row: Row, metrics: dict[str, Any], difference: dict[str, Any] | None) -> list[str]:
    crashed = f", {len(metrics['crashed'])} crashed" if metrics["crashed"] else ""
    zero = "" if metrics["L1"] is None else f" (0: {metrics['L1_constants']['+0']['0.3']:.3f})"
    return [
        row.system.title,
        *(rate_cell(metrics, name) for name in ("SR", "FSR", "DR")),
        l1_cell(metrics) + zero,
        f"{metrics['rounds']}{crashed}",
        PAPER.get(row.key, ""),
        *(_difference_cell(difference, name) for name in ("SR", "DR")),
        f"{metrics['seconds_per_round']:.1f}",
    ]


def _difference_cell(difference: dict[str, Any] | None, name: str) -> str:
    if difference is None:
        return ""
    found = difference[name]
    low, high = found["ci"]
    return f"{found['difference']:+.1f} ({low:+.1f} to {high:+.1f}), p {found['p']:.3f}"


def _origins(done: list[tuple[Row, dict[str, Any]]]) -> Iterator[str]:
    """The weights of every system, and the command behind every row."""
    yield "Weights, by the first digits of their SHA-256:"
    yield ""
    for row in {row.system.detector: row for row, _ in done}:
        metrics = next(metrics for other, metrics in done if other.system.detector == row)
        files = [
            f"{metrics[name]} {metrics[f'{name}_sha256'][:16]}"
            for name in ("weights", "restorer", "evaluator")
            if f"{name}_sha256" in metrics
        ]
        yield f"- {row}: {', '.join(files) or 'none'}"
    yield ""
    yield "Commands:"
    yield ""
    for _, metrics in done:
        yield f"- `{metrics['command']}` (commit {metrics['commit']}, {metrics['machine']})"
