"""Photos of an empty table that are kept: they come back, or what has changed since is said."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Picture

from neugrasp.errors import InputError
from neugrasp.geometry.pose import rigid, rotation_about
from neugrasp.robot.cell_file import CameraPart
from neugrasp.robot.wrist_camera import POSES, Shot, read_empty, write_empty
from robot_cells import example


@pytest.fixture
def part() -> CameraPart:
    return example().camera


@pytest.fixture
def kept(part: CameraPart, tmp_path: Path, rng: np.random.Generator) -> Path:
    shots = [
        Shot(
            replace(part.camera, world_from_camera=rigid(rotation_about((0, 0, 1), i), (0.1 * i, 0, 0.5))),
            rng.integers(0, 256, (part.camera.height, part.camera.width, 3), dtype=np.uint8),
        )
        for i in range(2)
    ]
    write_empty(tmp_path / "cell_empty", shots, part)
    return tmp_path / "cell_empty"


def test_they_come_back_as_they_were_taken(kept: Path, part: CameraPart):
    first, second = read_empty(kept, part)
    np.testing.assert_array_equal(first.image, np.asarray(Picture.open(kept / "0.png")))
    np.testing.assert_allclose(second.camera.world_from_camera[:3, 3], (0.1, 0, 0.5))
    assert second.camera.intrinsics is part.camera.intrinsics


def test_another_lens_has_other_photos(kept: Path, part: CameraPart):
    bent = replace(part, lens=replace(part.lens, radial=(0.1, 0.0, 0.0)))
    longer = replace(
        part, camera=replace(part.camera, intrinsics=part.camera.intrinsics * [[1.1], [1.1], [1]])
    )
    for other in (bent, longer):
        with pytest.raises(InputError, match="the cell file has another lens now; take the photos again"):
            read_empty(kept, other)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda told: told["poses"], "of another version"),
        (lambda told: {**told, "version": 2}, "of another version"),
        (lambda told: {**told, "poses": 3}, "poses is 3; it must be a list"),
        (lambda told: {**told, "poses": [[1], [1, 2]]}, r"poses\[0\]: of another shape or type"),
        (lambda told: {**told, "poses": [np.diag([2.0, 2, 2, 1]).tolist()]}, "it scales by 2"),
        (lambda told: {**told, "poses": 3 * told["poses"][:1]}, r"2\.png: missing"),
    ],
)
def test_what_is_damaged_is_named(kept: Path, part: CameraPart, change: Callable[[Any], Any], words: str):
    told = json.loads((kept / POSES).read_text())
    (kept / POSES).write_text(json.dumps(change(told)))
    with pytest.raises(InputError, match=words):
        read_empty(kept, part)


def test_photos_of_another_size_are_told(kept: Path, part: CameraPart):
    Picture.new("RGB", (320, 180)).save(kept / "1.png")
    with pytest.raises(InputError, match=r"1\.png: of another size; take the photos again"):
        read_empty(kept, part)
