"""Tables of models trained alike but for one thing: a part of the network, or the number of scenes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from neugrasp.evaluation.tables import l1_cell, rate_cell

Metrics = dict[str, Any]

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

    Where a recipe was trained on several numbers of scenes, the largest counts.
    """
    models = {recipe: _by_scenes(rows, recipe) for recipe in NAMES}
    known = [recipe for recipe in NAMES if models[recipe]]
    yield from _head("model", "steps, scenes")
    for recipe in known:
        scenes, some = models[recipe][-1]
        yield _line(NAMES[recipe], f"{_steps(some)}, {scenes}", some)
    for recipe in known:
        if (recipe, SCENES[0]) in PAPER:
            figures = [text for scene in SCENES for text in _published(PAPER[recipe, scene])]
            yield "| " + " | ".join([f"paper: {NAMES[recipe]}", "", *figures, ""]) + " |"


def scenes_table(rows: dict[str, Metrics]) -> Iterator[str]:
    """The full model by the number of scenes that it was trained on; nothing where there is but one."""
    models = _by_scenes(rows, FULL)
    if len(models) < 2:
        return
    yield from _head("scenes", "steps")
    for scenes, some in models:
        yield _line(str(scenes), _steps(some), some)


def _by_scenes(rows: dict[str, Metrics], recipe: str) -> list[tuple[int, dict[str, Metrics]]]:
    """The rows of a recipe, pile and packed, by the number of scenes trained on, rising."""
    models: dict[int, dict[str, Metrics]] = {}
    for row in rows.values():
        trained = row.get("trained", {})
        if trained.get("recipe") == recipe:
            models.setdefault(trained.get("scenes", 0), {})[row["scene"]] = row
    return sorted(models.items())


def _steps(model: dict[str, Metrics]) -> str:
    return str(next(iter(model.values()))["trained"].get("steps", "?"))


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
