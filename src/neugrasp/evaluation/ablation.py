"""The table of ablations: what each part of the network is worth at one budget, beside the paper's."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from neugrasp.evaluation.tables import l1_cell, rate_cell

Metrics = dict[str, Any]

NAMES = {
    "without-attention": "without the gate of Eq. 7 (f_attn)",
    "without-occupancy": "without the occupancy prior (V_occ)",
    "without-backgrounds": "without backgrounds",
    "small": "full",
    "tsdf": "full, taught the true TSDF instead",
}
SCENES = ("pile", "packed")
FIGURES = ("SR", "FSR", "DR", "L1")
PAPER = {
    ("without-attention", "pile"): (51.4, 41.6, 21.6, 0.906),
    ("without-attention", "packed"): (76.3, 73.0, 69.1, 0.887),
    ("without-occupancy", "pile"): (61.8, 65.0, 42.6, 0.360),
    ("without-occupancy", "packed"): (82.2, 83.0, 78.1, 0.321),
    ("without-backgrounds", "pile"): (58.3, 62.5, 44.4, 0.403),
    ("without-backgrounds", "packed"): (79.6, 82.0, 78.5, 0.378),
    ("small", "pile"): (65.2, 67.5, 45.6, 0.164),
    ("small", "packed"): (86.3, 86.0, 81.0, 0.153),
}
"""The paper's table of ablations, transparent and specular objects: SR, FSR, DR in percent, L1."""


def ablation_table(rows: dict[str, Metrics]) -> Iterator[str]:
    """A line for each recipe: SR, FSR, DR and L1 of piles and of packed scenes, then the paper's."""
    cells = {(_recipe(row), row["scene"]): row for row in rows.values()}
    heads = ["model", "steps, scenes", *(f"{s}: {f}" for s in SCENES for f in FIGURES), "rounds"]
    yield "| " + " | ".join(heads) + " |"
    yield "|" + "---|" * len(heads)
    known = [recipe for recipe in NAMES if any((recipe, scene) in cells for scene in SCENES)]
    for recipe in known:
        some = [cells.get((recipe, scene)) for scene in SCENES]
        trained = next(row["trained"] for row in some if row)
        rounds = ", ".join(str(row["rounds"]) if row else "-" for row in some)
        figures = [text for row in some for text in _measured(row)]
        steps = f"{trained.get('steps', '?')}, {trained.get('scenes', '?')}"
        yield "| " + " | ".join([NAMES[recipe], steps, *figures, rounds]) + " |"
    for recipe in known:
        if (recipe, SCENES[0]) in PAPER:
            figures = [text for scene in SCENES for text in _published(PAPER[recipe, scene])]
            yield "| " + " | ".join([f"paper: {NAMES[recipe]}", "", *figures, ""]) + " |"


def _recipe(row: Metrics) -> str:
    return str(row.get("trained", {}).get("recipe", "unknown"))


def _measured(row: Metrics | None) -> list[str]:
    if row is None:
        return ["-"] * len(FIGURES)
    return [*(rate_cell(row, name) for name in FIGURES[:-1]), l1_cell(row)]


def _published(figures: tuple[float, ...]) -> list[str]:
    *rates, l1 = figures
    return [*(f"{rate:.1f}" for rate in rates), f"{l1:.3f}"]
