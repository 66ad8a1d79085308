"""A measurement as JSON and as a table."""

from __future__ import annotations

import json
import statistics
from dataclasses import asdict
from pathlib import Path
from typing import Any

from neugrasp.bench.machine import Machine, Rates
from neugrasp.bench.measure import Inference, Measurement, Series, Training
from neugrasp.bench.recorder import Cost
from neugrasp.bench.stages import OTHER
from neugrasp.output import write_text
from neugrasp.run_folder import source_commit

FORMAT, VERSION = "neugrasp-bench", 1
ORDER = (
    "prepare",
    "encode images",
    "backgrounds",
    "foreground",
    "voxel maps",
    "volumes",
    "field query",
    "grasp head",
    "selection",
    "ray field",
    "ray weights",
    "grid rays",
    "losses",
    "backward",
    "optimiser",
    OTHER,
)
"""The stages as a table shows them."""
ROW = "{:<16}{:>10}{:>9}{:>9}{:>8}{:>13}{:>12}"
HEADER = ROW.format("", "median ms", "+- ms", "GFLOP", "MB", "roofline ms", "x roofline")


def summary(found: Measurement) -> dict[str, Any]:
    """Everything as plain data; what a reader looks for first stands at the top."""
    settings = found.settings
    report: dict[str, Any] = {"format": FORMAT, "version": VERSION, "command": settings.command()}
    if found.inference:
        report["photos_to_grasps_s"] = _median(found.inference.stages)
        report["files_to_grasps_s"] = report["photos_to_grasps_s"] + _median(found.inference.loading)
    if found.training:
        report["training_step_s"] = _median(found.training.stages)
    report["commit"] = source_commit()
    report |= {name: getattr(settings, name) for name in ("network", "views", "precision", "seed")}
    report["machine"] = _machine(found.machine, found.rates)
    if found.inference:
        report["inference"] = _inference(found.inference, found.rates)
    if found.training:
        report["training"] = _training(found.training, found.rates)
    return report


def table(report: dict[str, Any]) -> str:
    """The summary for people."""
    lines = _machine_lines(report["machine"])
    if "inference" in report:
        part = report["inference"]
        lines += ["", f"Photos to grasps, network {report['network']}, {report['views']} views", HEADER]
        lines += [_line(row) for row in (*part["stages"], part["total"], *part["outside"])]
        lines += [_cpu_line(part["total"]), *_notes(part)]
    if "training" in report:
        part = report["training"]
        lines += ["", f"A training step, network {report['network']}, one scene", HEADER]
        lines += [_line(row) for row in (*part["stages"], part["total"])]
        kept = part["kept_for_backward_bytes"] / 1e9
        lines += [_cpu_line(part["total"]), f"kept for the backward pass: {kept:.2f} GB"]
    return "\n".join(lines)


def _cpu_line(total: dict[str, Any]) -> str:
    """Processor time of all threads, which other programs hardly lengthen."""
    return f"processor time {total['cpu_s']:.2f} s"


def _notes(inference: dict[str, Any]) -> list[str]:
    lines = []
    if inference["peak_memory_bytes"]:
        lines.append(f"peak memory {inference['peak_memory_bytes'] / 1e9:.2f} GB")
    return lines


def write_json(file: Path, report: dict[str, Any]) -> None:
    """The summary as a file, whole or not at all. Raises `NeuGraspError` where it cannot be written."""
    write_text(file, json.dumps(report, indent=1) + "\n")


def _median(series: Series) -> float:
    return statistics.median(run.seconds for run in series.runs)


def _machine(machine: Machine, rates: Rates) -> dict[str, Any]:
    return {
        **asdict(machine),
        "busy": machine.is_busy,
        "products_flop_per_s": rates.flops,
        "copy_bytes_per_s": rates.copy,
    }


def _inference(found: Inference, rates: Rates) -> dict[str, Any]:
    outside = [row for one in (found.loading, found.new_backgrounds) for row in _rows(one, rates)]
    return {
        **_stages(found.stages, rates),
        "outside": [row for row in outside if row["stage"] != OTHER],
        "peak_memory_bytes": found.memory,
    }


def _training(found: Training, rates: Rates) -> dict[str, Any]:
    return {**_stages(found.stages, rates), "kept_for_backward_bytes": found.kept}


def _stages(series: Series, rates: Rates) -> dict[str, Any]:
    rows = _rows(series, rates)
    # The stages run one after the other, so their rooflines add up.
    roofline = sum(row["floor_s"] or 0.0 for row in rows)
    return {"total": _row("total", _total(series), roofline), "stages": rows}


def _rows(series: Series, rates: Rates) -> list[dict[str, Any]]:
    """A row for every stage."""
    names = sorted(series.costs, key=lambda name: ORDER.index(name) if name in ORDER else -1)
    return [_row(name, _stage(series, name), rates.roofline(series.costs[name])) for name in names]


def _row(name: str, timing: dict[str, Any], roofline: float) -> dict[str, Any]:
    return {
        "stage": name,
        **timing,
        "floor_s": roofline or None,
        "times_the_floor": timing["seconds"] / roofline if roofline else None,
    }


def _stage(series: Series, name: str) -> dict[str, Any]:
    seconds = [run.stages[name].seconds if name in run.stages else 0.0 for run in series.runs]
    return _timing(seconds, series.costs.get(name, Cost()))


def _total(series: Series) -> dict[str, Any]:
    total = Cost()
    for cost in series.costs.values():
        total.add(cost)
    cpu = statistics.median(run.cpu_seconds for run in series.runs)
    return {**_timing([run.seconds for run in series.runs], total), "cpu_s": cpu}


def _timing(seconds: list[float], cost: Cost) -> dict[str, Any]:
    return {
        "seconds": statistics.median(seconds),
        "quartiles_s": _quartiles(seconds),
        "all_s": seconds,
        "flop": cost.flops,
        "bytes": cost.num_bytes,
    }


def _quartiles(seconds: list[float]) -> list[float]:
    if len(seconds) < 2:
        return [seconds[0], seconds[0]]
    low, _, high = statistics.quantiles(seconds, n=4, method="inclusive")
    return [low, high]


def _machine_lines(machine: dict[str, Any]) -> list[str]:
    rates = machine["products_flop_per_s"]
    lines = [
        f"{machine['processor']}, {machine['cores']} cores, {machine['threads']} threads; "
        f"device {machine['device']}; PyTorch {machine['torch']}",
        f"products {rates['float32'] / 1e9:,.0f} GFLOP/s in float32, "
        f"{rates['bfloat16'] / 1e9:,.0f} in bfloat16; copies {machine['copy_bytes_per_s'] / 1e9:,.1f} GB/s",
    ]
    if machine["busy"]:
        lines.append(f"busy (load {machine['load']:.1f} before the start): times are too long, ratios vague")
    return lines


def _line(row: dict[str, Any]) -> str:
    low, high = row["quartiles_s"]
    return ROW.format(
        row["stage"],
        _milli(row["seconds"]),
        _milli((high - low) / 2),
        f"{sum(row['flop'].values()) / 1e9:.2f}",
        f"{row['bytes'] / 1e6:,.0f}",
        _milli(row["floor_s"]),
        _times(row["times_the_floor"]),
    ).rstrip()


def _milli(seconds: float | None) -> str:
    return "" if seconds is None else f"{seconds * 1e3:,.1f}"


def _times(ratio: float | None) -> str:
    return "" if ratio is None else f"{ratio:,.1f}"
