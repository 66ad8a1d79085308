"""Tables of models trained alike but for one thing: a part of the network, or the budget of training."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

from neugrasp.evaluation.tables import l1_cell, rate_cell

Metrics = dict[str, Any]
Budget = tuple[int, int]
"""Steps of training, and scenes trained on."""

FULL = "small"
CONTROL = "tsdf"
"""The recipe that is taught the true surface."""
NAMES = {
    "without-attention": "without the gate of Eq. 7 (f_attn)",
    "without-occupancy": "without the occupancy prior (V_occ)",
    "without-backgrounds": "without backgrounds",
    FULL: "full",
    CONTROL: "full, taught the true TSDF instead",
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
    (FULL, "pile"): (65.2, 67.5, 45.6, 0.164),
    (FULL, "packed"): (86.3, 86.0, 81.0, 0.153),
}
"""The paper's table of ablations, transparent and specular objects: SR, FSR, DR in percent, L1."""


def ablation_table(rows: dict[str, Metrics]) -> Iterator[str]:
    """A line for each recipe: SR, FSR, DR and L1 of piles and of packed scenes, then the paper's.

    Of a recipe that was trained several times, the model with the budget that most recipes share stands here,
    of equally shared budgets the largest.
    """
    models = {recipe: some for recipe in NAMES if (some := _by_budget(rows, recipe))}
    shared = Counter(budget for some in models.values() for budget in some)
    yield from _head("model", "steps, scenes")
    for recipe, some in models.items():
        budget = max(some, key=lambda budget: (shared[budget], budget))
        yield _line(NAMES[recipe], ", ".join(map(str, budget)), some[budget])
    for recipe in models:
        if (recipe, SCENES[0]) in PAPER:
            figures = [text for scene in SCENES for text in _published(PAPER[recipe, scene])]
            yield "| " + " | ".join([f"paper: {NAMES[recipe]}", "", *figures, ""]) + " |"


def scenes_table(rows: dict[str, Metrics]) -> Iterator[str]:
    """The full model by the steps and scenes of its training; nothing where there is but one."""
    models = _by_budget(rows, FULL)
    if len(models) < 2:
        return
    yield from _head("steps", "scenes")
    for (steps, scenes), some in models.items():
        yield _line(str(steps), str(scenes), some)


def _by_budget(rows: dict[str, Metrics], recipe: str) -> dict[Budget, dict[str, Metrics]]:
    """The rows of a recipe, pile and packed, by the budget of its training, rising."""
    models: dict[Budget, dict[str, Metrics]] = {}
    for row in rows.values():
        trained = row.get("trained", {})
        if trained.get("recipe") == recipe:
            models.setdefault((trained.get("steps", 0), trained.get("scenes", 0)), {})[row["scene"]] = row
    return dict(sorted(models.items()))


def _head(*names: str) -> Iterator[str]:
    heads = [*names, *(f"{scene}: {figure}" for scene in SCENES for figure in FIGURES), "rounds"]
    yield "| " + " | ".join(heads) + " |"
    yield "|" + "---|" * len(heads)


def _line(name: str, training: str, model: dict[str, Metrics]) -> str:
    some = [model.get(scene) for scene in SCENES]
    figures = [text for row in some for text in _measured(row)]
    rounds = ", ".join(str(row["rounds"]) if row else "-" for row in some)
    return "| " + " | ".join([name, training, *figures, rounds]) + " |"


def _measured(row: Metrics | None) -> list[str]:
    if row is None:
        return ["-"] * len(FIGURES)
    return [*(rate_cell(row, name) for name in FIGURES[:-1]), l1_cell(row)]


def _published(figures: tuple[float, ...]) -> list[str]:
    *rates, l1 = figures
    return [*(f"{rate:.1f}" for rate in rates), f"{l1:.3f}"]
