"""Evaluations and comparisons, for reading in a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from neugrasp.metrics import L1_MASKS

RATE = "{:<22} {:>8} {:>18}  {}"


def metrics_table(metrics: dict[str, Any]) -> str:
    """What metrics.json says."""
    return "\n".join(_lines(metrics))


def _lines(m: dict[str, Any]) -> Iterator[str]:
    yield (
        f"{m['detector']}, {m['scene']}, {m['materials']}, strategy {m['strategy']}, "
        f"protocol {m['protocol']}, views {m['views']}, seed {m['seed']}"
    )
    yield RATE.format("", "%", "95 % interval", "")
    yield _rate(m, "SR", f"{m['successes']} of {m['attempts']} grasps")
    yield _rate(m, "FSR", f"of {m['rounds']} rounds")
    yield _rate(m, "DR", f"of {m['objects']} objects")
    if m["crashed"]:
        yield f"CRASHED, counted nowhere: rounds {', '.join(map(str, m['crashed']))}"
    yield "rounds ended: " + ", ".join(f"{count} {name}" for name, count in m["endings"].items())
    yield "failures: " + ", ".join(f"{count} {reason}" for reason, count in m["failures"].items())
    if m["L1_by_mask"]:
        yield ""
        masks = [str(mask) for mask in L1_MASKS]
        yield ("{:<14}" + " {:>8}" * len(masks)).format("L1 under mask", *masks)
        for name, values in {"detector": m["L1_by_mask"], **m["L1_constants"]}.items():
            label = name if name == "detector" else f"constant {name}"
            yield ("{:<14}" + " {:>8.3f}" * len(masks)).format(label, *(values[mask] for mask in masks))
    yield ""
    stages = ", ".join(f"{stage} {seconds:.1f}" for stage, seconds in m["seconds_by_stage"].items())
    yield f"{m['seconds_per_round']:.1f} s a round: {stages}"


def _rate(metrics: dict[str, Any], name: str, count: str) -> str:
    value, interval = metrics[name], metrics[f"{name}_ci"]
    if value is None:
        return RATE.format(name, "-", "-", count)
    return RATE.format(name, f"{value:.1f}", f"{interval[0]:.1f} to {interval[1]:.1f}", count)


def rate_cell(row: dict[str, Any], name: str) -> str:
    """A rate of metrics.json with its interval, for a table of many rows."""
    if row[name] is None:
        return "-"
    low, high = row[f"{name}_ci"]
    return f"{row[name]:.1f} ({low:.1f} to {high:.1f})"


def l1_cell(row: dict[str, Any]) -> str:
    """The headline L1 of metrics.json."""
    return "-" if row["L1"] is None else f"{row['L1']:.3f}"


def comparison_table(comparison: dict[str, Any]) -> str:
    """What `compare` found."""
    lines = [
        f"{comparison['rounds']} rounds that both played; differences are B - A in percentage points",
        "{:<6} {:>8} {:>8} {:>11} {:>18} {:>8}".format("", "A", "B", "difference", "95 % interval", "p"),
    ]
    for name in ("SR", "FSR", "DR"):
        row = comparison[name]
        interval = f"{row['ci'][0]:+.1f} to {row['ci'][1]:+.1f}"
        lines.append(
            f"{name:<6} {row['a']:>8.1f} {row['b']:>8.1f} {row['difference']:>+11.1f} {interval:>18} "
            f"{row['p']:>8.4f}"
        )
    return "\n".join(lines)
