"""Four photos of a patterned table, so that wrong poses show, and an import of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from foreign_formats import Similarity
from neugrasp import cli
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import look_at
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import View, Views


def photo(camera: Camera, height: float) -> np.ndarray:
    """A table with a pattern of several wave lengths, seen by a camera, no noise."""
    grid = camera.pixel_grid()
    towards = camera.unproject(grid, np.ones(grid.shape[:2])) - camera.centre
    points = camera.centre + towards * ((height - camera.centre[2]) / towards[..., 2:])
    x, y = points[..., 0], points[..., 1]
    waves = np.sin(71 * x + 13 * y) + np.sin(-37 * x + 83 * y + 1) + np.sin(151 * x - 97 * y + 2)
    return np.repeat((128 + 30 * waves).round().astype(np.uint8)[..., None], 3, axis=-1)


def patterned_views() -> Views:
    """Four photos of a patterned table, 160 x 120, the cube's floor at the origin."""
    workspace = Workspace()
    intrinsics = np.array([[150.0, 0, 79.5], [0, 150, 59.5], [0, 0, 1]])
    taken = []
    for angle in np.deg2rad([-135, -105, -75, -45]):
        eye = workspace.centre + 0.5 * np.array([0.53 * np.cos(angle), 0.53 * np.sin(angle), 0.85])
        camera = Camera(intrinsics, look_at(eye, (0.15, 0.15, 0.05)), 160, 120)
        pixels = photo(camera, workspace.table_height)
        taken.append(View(camera, pixels, pixels))
    return Views(tuple(taken), workspace)


def imported(folder: Path, arguments: list[str], views: Views) -> int:
    alignment = Similarity().write(folder / "alignment.json", views)
    return cli.main(["import", *arguments, "--alignment", str(alignment), "--out", str(folder / "scene")])


def edited(file: Path, edit: Callable[[dict[str, Any]], None]) -> Path:
    data = json.loads(file.read_text())
    edit(data)
    file.write_text(json.dumps(data))
    return file
