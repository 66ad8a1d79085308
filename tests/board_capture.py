"""Photos of the standard board from a camera on a flange whose poses are known exactly."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from PIL import Image as Picture

from neugrasp.geometry.pose import Array, from_rotation_vector, inverse
from neugrasp.importers.board import Board
from table_photos import camera_at, photo_of_table

CAMERA = from_rotation_vector([0.02, -0.05, 1.5], [0.01, 0.08, 0.03])
"""`flange_from_camera`."""


def write_board_photos(folder: Path, count: int = 10) -> None:
    """The photos and robot.json."""
    board, rng, views = Board(), np.random.default_rng(0), []
    width, height = board.print.size
    middle = np.array([width / 2, height / 2, 0])
    for number in range(count):
        eye = middle + np.array([*rng.uniform(-0.25, 0.25, 2), rng.uniform(0.3, 0.45)])
        camera = camera_at(eye, middle + np.array([*rng.uniform(-0.03, 0.03, 2), 0]))
        flange: Array = camera.world_from_camera @ inverse(CAMERA)
        Picture.fromarray(photo_of_table(board, camera)).save(folder / f"{number}.png")
        views.append({"image": f"{number}.png", "base_from_flange": flange.tolist()})
    lens = {"intrinsics": camera.intrinsics.tolist(), "width": camera.width, "height": camera.height}
    (folder / "robot.json").write_text(json.dumps({**lens, "views": views}))
