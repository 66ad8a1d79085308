"""A work cell drawn at random: cropped cameras, light, table and surroundings."""

from __future__ import annotations

from typing import Any

import numpy as np

from neugrasp.data.world import Cell
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.view_sets import hemisphere, view_set
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.textures import TABLE_PATTERNS, Texture, sample_texture

HDRIS: dict[str, tuple[str, ...]] = {
    "train": ("city", "courtyard", "forest", "night", "studio", "sunset"),
    "test": ("interior", "sunrise"),
}
"""The eight panoramas that come with Blender, divided."""

LUMINANCE: dict[str, float] = {
    "city": 2.30,
    "courtyard": 0.94,
    "forest": 1.72,
    "interior": 1.82,
    "night": 0.22,
    "studio": 0.74,
    "sunrise": 0.96,
    "sunset": 0.80,
}
"""Radiance of white paper under each panorama, for which cameras expose: the geometric mean of paper that
lies flat and of paper tilted by 45 degrees to the brightest side. A low sun lights upright sides most."""

TABLE_SIZE = (0.898, 1.3)
"""Metres, as in the released generator."""
FLOOR_DROP = 0.75
"""Metres from the table's surface down to the floor."""

SPLITS = ("train", "test")


def sample_cell(
    workspace: Workspace, view_set_name: str, seed: int, split: str, size: int = 256, num_targets: int = 4
) -> Cell:
    """The cell of a seed: the views of a named set, then `num_targets` views from the whole hemisphere.

    Cameras are cropped to the workspace and resized to `size` x `size`. Training and test cells share no
    panorama and no random stream. Raises `InputError` on an unknown view set or split.
    """
    if split not in SPLITS:
        raise InputError(f"unknown split {split!r}; choose one of {', '.join(SPLITS)}")
    rng = np.random.default_rng([seed, SPLITS.index(split), 20250])
    inputs = view_set(view_set_name, workspace, rng)
    cameras = [*inputs, *hemisphere(workspace, rng, num_targets)]
    light, table = _light(workspace, rng, split), _table(workspace, rng, split)
    return Cell(
        seed=seed,
        cameras=tuple(_cropped(workspace, camera, size) for camera in cameras),
        num_inputs=len(inputs),
        light={**light, "exposure": light["exposure"] + _compensation(table["texture"])},
        table=table,
    )


def _cropped(workspace: Workspace, camera: Camera, size: int) -> Camera:
    return camera.cropped_and_resized(workspace.photo_box(camera), size, size)


def _light(workspace: Workspace, rng: np.random.Generator, split: str) -> dict[str, Any]:
    """A panorama turned about z, exposed for, and in training up to two soft lamps beside it."""
    hdri = str(rng.choice(HDRIS[split]))
    strength = rng.uniform(0.8, 1.2)
    num_lamps = int(rng.choice([0, 1, 2], p=[0.6, 0.25, 0.15])) if split == "train" else 0
    lamps = [_lamp(workspace, rng) for _ in range(num_lamps)]
    added = sum(lamp["irradiance"] for lamp in lamps)
    return {
        "hdri": hdri,
        "rotation": float(rng.uniform(-np.pi, np.pi)),
        "strength": float(strength / LUMINANCE[hdri]),
        "exposure": float(-np.log2(1 + added)),
        "lamps": lamps,
    }


def _compensation(texture: Texture) -> float:
    """Stops by which a camera with automatic exposure opens over a dark table or closes over a bright one."""
    brightness = float(np.mean(texture["colours"]))
    return float(np.clip(0.4 * np.log2(0.3 / brightness), -0.4, 0.8))


def _lamp(workspace: Workspace, rng: np.random.Generator) -> dict[str, Any]:
    """A square lamp above the table, given by the irradiance it adds to the panorama's 1."""
    polar, azimuth = np.deg2rad(rng.uniform(5, 50)), rng.uniform(0, 2 * np.pi)
    distance = rng.uniform(1.0, 2.0)
    direction = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    warmth = rng.uniform(-0.2, 0.2)
    return {
        "position": (workspace.centre + distance * np.array(direction)).tolist(),
        "target": workspace.centre.tolist(),
        "size": float(rng.uniform(0.2, 0.8)),
        "irradiance": float(rng.uniform(0.2, 1.0)),
        "colour": [1 + warmth, 1.0, 1 - warmth],
    }


def _table(workspace: Workspace, rng: np.random.Generator, split: str) -> dict[str, Any]:
    """The table's place, surface and finish, the floor, and sometimes a wall behind it."""
    shift = [rng.uniform(-0.02, 0.02), rng.uniform(-0.084, -0.024)] if split == "train" else [0.0, 0.0]
    centre = workspace.centre
    wall = None
    if rng.random() < 0.5:
        wall = {
            "azimuth": float(rng.uniform(0, 2 * np.pi)),
            "distance": float(rng.uniform(1.0, 2.5)),
            "texture": sample_texture(rng, ("plain", "tiles", "planks", "marble"), flat=True),
        }
    return {
        "centre": [float(centre[0] + shift[0]), float(centre[1] + shift[1]), workspace.table_height],
        "size": list(TABLE_SIZE),
        "texture": sample_texture(rng, TABLE_PATTERNS, flat=True),
        "roughness": float(rng.uniform(0.25, 0.95)),
        "specular": float(rng.uniform(0.1, 0.5)),
        "floor": {
            "height": workspace.table_height - FLOOR_DROP,
            "texture": sample_texture(rng, TABLE_PATTERNS, flat=True),
        },
        "wall": wall,
    }
