"""Materials of objects: presets of the paper's classes, their jitter, and the mixes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from neugrasp.data.world import Material, Scene
from neugrasp.errors import InputError
from neugrasp.simulation.textures import OBJECT_PATTERNS, colour, sample_texture, wood_colours

Parameters = dict[str, Any]
"""Inputs of the Principled BSDF by short names, plus `texture`, `texture_mix` and `bump`."""

KINDS = ("diffuse", "specular", "transparent")

MIXES: dict[str, dict[str, float]] = {
    "mixed": {"diffuse": 1 / 3, "specular": 1 / 3, "transparent": 1 / 3},
    "transparent-specular": {"transparent": 2 / 3, "specular": 1 / 3},
    "diffuse": {"diffuse": 1.0},
    "specular": {"specular": 1.0},
    "transparent": {"transparent": 1.0},
}


def _metal(r: float, g: float, b: float, roughness: float, anisotropic: float = 0.0) -> Parameters:
    return {
        "base_color": [r, g, b],
        "metallic": 1.0,
        "roughness": roughness,
        "anisotropic": anisotropic,
    }


def _dielectric(r: float, g: float, b: float, roughness: float, **more: float) -> Parameters:
    return {"base_color": [r, g, b], "metallic": 0.0, "roughness": roughness, **more}


def _glass(r: float, g: float, b: float, ior: float, roughness: float) -> Parameters:
    return {
        "base_color": [r, g, b],
        "metallic": 0.0,
        "roughness": roughness,
        "ior": ior,
        "transmission": 1.0,
    }


PRESETS: dict[str, dict[str, dict[str, Parameters]]] = {
    "specular": {
        "metal": {
            "steel": _metal(0.56, 0.57, 0.58, 0.18),
            "brushed_steel": _metal(0.53, 0.53, 0.53, 0.32, 0.7),
            "chrome": _metal(0.62, 0.63, 0.64, 0.04),
            "aluminium": _metal(0.82, 0.83, 0.84, 0.22),
            "brushed_aluminium": _metal(0.78, 0.79, 0.80, 0.30, 0.8),
            "cast_iron": _metal(0.30, 0.29, 0.28, 0.45),
            "silver": _metal(0.93, 0.91, 0.86, 0.08),
            "gold": _metal(0.90, 0.66, 0.28, 0.10),
            "rose_gold": _metal(0.88, 0.58, 0.46, 0.14),
            "copper": _metal(0.86, 0.49, 0.34, 0.15),
            "brass": _metal(0.80, 0.64, 0.30, 0.20),
            "bronze": _metal(0.58, 0.40, 0.22, 0.28),
            "titanium": _metal(0.48, 0.45, 0.41, 0.30),
            "nickel": _metal(0.64, 0.58, 0.50, 0.12),
            "tin": _metal(0.70, 0.70, 0.68, 0.25),
        },
        "porcelain": {
            "white": _dielectric(0.80, 0.80, 0.78, 0.08, coat=0.6),
            "ivory": _dielectric(0.76, 0.70, 0.58, 0.10, coat=0.5),
            "celadon": _dielectric(0.42, 0.58, 0.48, 0.10, coat=0.7),
            "cobalt": _dielectric(0.04, 0.09, 0.38, 0.06, coat=0.8),
            "black": _dielectric(0.02, 0.02, 0.025, 0.06, coat=0.8),
            "oxblood": _dielectric(0.35, 0.03, 0.03, 0.07, coat=0.8),
            "turquoise": _dielectric(0.06, 0.42, 0.45, 0.08, coat=0.7),
        },
        "glossy_plastic": {
            "light": _dielectric(0.70, 0.70, 0.70, 0.12, specular=0.6),
            "strong": _dielectric(0.55, 0.06, 0.05, 0.10, specular=0.6),
        },
        "paint": {
            "red": _dielectric(0.50, 0.02, 0.02, 0.30, coat=1.0, coat_roughness=0.03),
            "blue": _dielectric(0.02, 0.08, 0.42, 0.30, coat=1.0, coat_roughness=0.03),
            "green": _dielectric(0.02, 0.25, 0.08, 0.30, coat=1.0, coat_roughness=0.04),
            "white": _dielectric(0.78, 0.78, 0.78, 0.25, coat=1.0, coat_roughness=0.03),
            "black": _dielectric(0.02, 0.02, 0.02, 0.25, coat=1.0, coat_roughness=0.02),
            "flake": {
                "base_color": [0.35, 0.38, 0.42],
                "metallic": 0.6,
                "roughness": 0.35,
                "coat": 1.0,
                "coat_roughness": 0.03,
            },
        },
    },
    "transparent": {
        "glass": {
            "clear": _glass(1.0, 1.0, 1.0, 1.45, 0.0),
            "crown": _glass(0.985, 0.995, 0.99, 1.52, 0.0),
            "acrylic": _glass(0.98, 0.99, 1.0, 1.49, 0.02),
            "water_like": _glass(1.0, 1.0, 1.0, 1.33, 0.0),
            "frosted": _glass(0.98, 0.98, 0.98, 1.40, 0.09),
        },
        "tinted_glass": {
            "green": _glass(0.80, 0.95, 0.84, 1.48, 0.0),
            "blue": _glass(0.80, 0.90, 0.98, 1.46, 0.0),
            "amber": _glass(0.95, 0.80, 0.58, 1.48, 0.0),
            "grey": _glass(0.78, 0.79, 0.80, 1.45, 0.01),
        },
    },
    "diffuse": {
        "plastic": {
            "matt": _dielectric(0.5, 0.5, 0.5, 0.55, specular=0.35),
            "satin": _dielectric(0.6, 0.6, 0.6, 0.42, specular=0.4),
            "dark": _dielectric(0.06, 0.06, 0.06, 0.5, specular=0.35),
        },
        "rubber": {
            "black": _dielectric(0.03, 0.03, 0.03, 0.8, specular=0.2),
            "grey": _dielectric(0.22, 0.22, 0.22, 0.75, specular=0.2),
            "red": _dielectric(0.42, 0.06, 0.04, 0.75, specular=0.2),
        },
        "paper": {
            "white": _dielectric(0.78, 0.77, 0.74, 0.9, specular=0.1),
            "card": _dielectric(0.48, 0.33, 0.19, 0.9, specular=0.1),
            "recycled": _dielectric(0.52, 0.50, 0.45, 0.95, specular=0.1),
        },
        "leather": {
            "brown": _dielectric(0.17, 0.07, 0.03, 0.6, specular=0.3, bump=0.3),
            "tan": _dielectric(0.42, 0.22, 0.10, 0.6, specular=0.3, bump=0.3),
            "black": _dielectric(0.03, 0.03, 0.03, 0.55, specular=0.35, bump=0.3),
        },
        "wood": {
            "raw": _dielectric(0.5, 0.33, 0.18, 0.75, specular=0.2),
            "waxed": _dielectric(0.4, 0.22, 0.10, 0.5, specular=0.3),
        },
        "clay": {
            "terracotta": _dielectric(0.50, 0.20, 0.11, 0.9, specular=0.1, bump=0.15),
            "grey": _dielectric(0.40, 0.39, 0.37, 0.9, specular=0.1, bump=0.15),
            "white": _dielectric(0.72, 0.70, 0.66, 0.9, specular=0.1, bump=0.15),
        },
        "fabric": {
            "cotton": _dielectric(0.6, 0.58, 0.54, 0.95, specular=0.05, sheen=0.3, bump=0.3),
            "wool": _dielectric(0.3, 0.28, 0.35, 1.0, specular=0.05, sheen=0.5, bump=0.4),
            "denim": _dielectric(0.08, 0.13, 0.28, 0.95, specular=0.05, sheen=0.3, bump=0.3),
        },
    },
}
"""kind -> sub-class -> preset -> parameters. Glass and tinted glass are drawn 2 : 1, others uniformly."""

OWN_COLOUR = ("metal", "porcelain", "leather", "wood", "clay")
"""Sub-classes whose preset colour is kept; the others take any colour."""


def sample_materials(scene: Scene, mix: str, rng: np.random.Generator) -> Scene:
    """The scene with one material per body, drawn independently. Raises `InputError` on an unknown mix."""
    if mix not in MIXES:
        raise InputError(f"unknown materials {mix!r}; choose one of {', '.join(MIXES)}")
    kinds = list(MIXES[mix])
    drawn = rng.choice(kinds, size=len(scene.bodies), p=[MIXES[mix][k] for k in kinds])
    return replace(scene, materials=tuple(sample_material(str(kind), rng) for kind in drawn))


def sample_material(kind: str, rng: np.random.Generator) -> Material:
    """A jittered material of one kind: sub-class, then preset, both uniform (glass 2 : 1 clear to tinted)."""
    classes = list(PRESETS[kind])
    weights = [2 / 3, 1 / 3] if kind == "transparent" else [1 / len(classes)] * len(classes)
    subclass = str(rng.choice(classes, p=weights))
    preset = str(rng.choice(list(PRESETS[kind][subclass])))
    parameters = PRESETS[kind][subclass][preset]
    jittered = (
        _glass_jitter(parameters, rng) if kind == "transparent" else _jitter(parameters, kind, subclass, rng)
    )
    return Material(kind, f"{subclass}/{preset}", jittered)


def _glass_jitter(preset: Parameters, rng: np.random.Generator) -> Parameters:
    tint = np.clip(np.array(preset["base_color"]) + rng.uniform(-0.02, 0.02, 3), 0.4, 1.0)
    return {
        **preset,
        "base_color": tint.round(4).tolist(),
        "ior": float(np.clip(preset["ior"] + rng.uniform(-0.03, 0.03), 1.31, 1.55)),
        "roughness": float(np.clip(preset["roughness"] + max(0.0, rng.uniform(-0.03, 0.02)), 0, 0.1)),
        "shadow_tint": float(rng.uniform(0.7, 0.92)),
    }


def _jitter(preset: Parameters, kind: str, subclass: str, rng: np.random.Generator) -> Parameters:
    """The preset moved within the released ranges, clipped to 0..1, in a new colour or texture."""

    def moved(name: str, low: float, high: float, default: float = 0.0) -> float:
        return float(np.clip(preset.get(name, default) + rng.uniform(low, high), 0, 1))

    shiny = subclass in ("porcelain", "glossy_plastic")
    roughness = (-0.2, 0.01) if kind == "specular" else (-0.03, 0.1)
    base, texture, mix = _surface(preset, kind, subclass, rng)
    return {
        "base_color": base,
        "metallic": moved("metallic", -0.05, 0.1 if shiny else 0.05),
        "roughness": max(moved("roughness", *roughness), 0.02),
        "ior": 1.5,
        "specular": moved("specular", 0.0, 0.3 if kind == "specular" else 0.1, 0.5),
        "anisotropic": moved("anisotropic", -0.1, 0.1) if subclass == "metal" else 0.0,
        "anisotropic_rotation": float(rng.uniform(0, 1)),
        "coat": moved("coat", -0.2, 0.2) if kind == "specular" else 0.0,
        "coat_roughness": moved("coat_roughness", 0.0, 0.1),
        "sheen": moved("sheen", -0.1, 0.1),
        "bump": preset.get("bump", 0.0),
        "texture": texture,
        "texture_mix": mix,
    }


def _surface(
    preset: Parameters, kind: str, subclass: str, rng: np.random.Generator
) -> tuple[list[float], dict[str, Any] | None, float]:
    """Base colour, texture (or None) and the share of the texture."""
    own = subclass in OWN_COLOUR or (kind == "specular" and rng.random() < 0.4)
    base = np.array(preset["base_color"] if own else colour(rng))
    base = np.clip(base + rng.uniform(-0.2, 0.2) * (0.3 if base.max() < 0.3 else 1), 0.02, 0.95)
    if subclass == "wood":
        texture = {**sample_texture(rng, ("wood",)), "colours": wood_colours(rng)}
        texture["scale"] = float(rng.uniform(10, 40))
        return base.round(4).tolist(), texture, 1.0
    textured = rng.random() < (1 / 3 if kind == "specular" else 0.7)
    if not textured:
        return base.round(4).tolist(), None, 0.0
    mix = rng.uniform(0.85, 0.98) if kind == "specular" else rng.uniform(0.7, 0.95)
    return base.round(4).tolist(), sample_texture(rng, OBJECT_PATTERNS), float(mix)
