"""Procedural textures as plain data: a pattern, colours, place. `blender_materials` builds them."""

from __future__ import annotations

import colorsys
from typing import Any

import numpy as np

Texture = dict[str, Any]
"""JSON-ready: pattern, colours (linear RGB, 0..1), scale (features per metre), offset, rotation, ..."""

TABLE_PATTERNS = ("wood", "tiles", "planks", "checker", "marble", "fabric", "plain", "speckled", "cells")
OBJECT_PATTERNS = ("noise", "marble", "cells", "checker", "bands", "magic", "speckled", "label")

SCALES: dict[str, tuple[float, float]] = {
    "wood": (5, 16),
    "tiles": (4, 30),
    "planks": (5, 20),
    "checker": (10, 50),
    "marble": (3, 20),
    "fabric": (80, 250),
    "plain": (5, 40),
    "speckled": (60, 300),
    "cells": (15, 80),
    "noise": (20, 120),
    "bands": (10, 60),
    "magic": (15, 60),
    "label": (8, 30),
}
"""Features per metre, drawn log-uniformly: a table at 0.5 m shows 0.3 m of itself."""


def sample_texture(rng: np.random.Generator, patterns: tuple[str, ...], flat: bool = False) -> Texture:
    """A random texture of one of the given patterns; `flat` keeps it upright, for planes with normal z."""
    pattern = str(rng.choice(patterns))
    low, high = SCALES[pattern]
    turn = rng.uniform(-np.pi, np.pi, size=3)
    return {
        "pattern": pattern,
        "colours": wood_colours(rng) if pattern in ("wood", "planks") else palette(rng),
        "scale": float(np.exp(rng.uniform(np.log(low), np.log(high)))),
        "offset": rng.uniform(-10, 10, size=3).round(4).tolist(),
        "rotation": [0.0, 0.0, round(float(turn[2]), 4)] if flat else turn.round(4).tolist(),
        "distortion": float(rng.uniform(0, 1)),
        "contrast": float(rng.uniform(0.4, 1)),
    }


def colour(rng: np.random.Generator) -> list[float]:
    """A linear RGB albedo in 0.02..0.85: greys, muted and saturated hues, dark and bright."""
    hue, saturation = rng.random(), rng.beta(0.8, 1.0)
    value = rng.uniform(0.2, 0.93)
    encoded = np.array(colorsys.hsv_to_rgb(hue, saturation, value))
    linear = encoded**2.2
    return np.clip(linear, 0.02, 0.85).round(4).tolist()


def palette(rng: np.random.Generator) -> list[list[float]]:
    """Three colours: kin of one colour, or unrelated ones."""
    first = np.array(colour(rng))
    if rng.random() < 0.4:
        return [first.tolist(), colour(rng), colour(rng)]
    kin = [
        np.clip(first * rng.uniform(0.35, 1.6) + rng.uniform(-0.03, 0.03, 3), 0.02, 0.85) for _ in range(2)
    ]
    return [first.tolist(), *(k.round(4).tolist() for k in kin)]


def wood_colours(rng: np.random.Generator) -> list[list[float]]:
    """A light, a middle and a dark brown of one kind of wood, from maple to wenge."""
    light = np.array([0.62, 0.40, 0.20]) * rng.uniform(0.25, 1.25) * rng.uniform(0.85, 1.15, 3)
    dark = light * rng.uniform(0.3, 0.75)
    return [np.clip(c, 0.02, 0.85).round(4).tolist() for c in (light, (light + dark) / 2, dark)]
