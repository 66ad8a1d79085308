"""`neugrasp calibrate` on drawn photos of a board."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, from_rotation_vector, inverse
from neugrasp.importers.board import Board
from neugrasp.operation.calibrate import run, sightings_of
from neugrasp.operation.command import Calibrate
from table_photos import camera_at, photo_of_table

pytestmark = pytest.mark.skipif(find_spec("cv2") is None, reason="needs neugrasp[capture]")

CAMERA = from_rotation_vector([0.02, -0.05, 1.5], [0.01, 0.08, 0.03])


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten photos of the standard board from a flange whose pose is known exactly."""
    folder = tmp_path_factory.mktemp("capture")
    board, rng, views = Board(), np.random.default_rng(0), []
    width, height = board.print.size
    middle = np.array([width / 2, height / 2, 0])
    for number in range(10):
        eye = middle + np.array([*rng.uniform(-0.25, 0.25, 2), rng.uniform(0.3, 0.45)])
        camera = camera_at(eye, middle + np.array([*rng.uniform(-0.03, 0.03, 2), 0]))
        flange: Array = camera.world_from_camera @ inverse(CAMERA)
        Picture.fromarray(photo_of_table(board, camera)).save(folder / f"{number}.png")
        views.append({"image": f"{number}.png", "base_from_flange": flange.tolist()})
    lens = {"intrinsics": camera.intrinsics.tolist(), "width": camera.width, "height": camera.height}
    (folder / "robot.json").write_text(json.dumps({**lens, "views": views}))
    return folder


def test_the_pose_is_found_and_said_as_a_cell_file_has_it(capture: Path):
    said = run(Calibrate(capture / "robot.json"))
    assert said.exit_code == 0
    (line,) = [line for line in said.text.splitlines() if line.startswith("flange_from_camera = ")]
    position = [float(x) for x in line.split("[")[1].split("]")[0].split(",")]
    np.testing.assert_allclose(position, CAMERA[:3, 3], atol=1.5e-3)
    assert "closed forms: Tsai" in said.text
    assert said.text.splitlines()[-1] == "next: neugrasp cell check CELL.toml"


def test_few_photos_are_called_weak_and_the_program_ends_with_one(capture: Path):
    data = json.loads((capture / "robot.json").read_text())
    few = capture / "few.json"
    few.write_text(json.dumps({**data, "views": data["views"][:5]}))
    said = run(Calibrate(few))
    assert said.exit_code == 1
    assert "weak:\n  5 photos; take 10 or more" in said.text


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"views": []}, "'views' must be a list"),
        ({"views": [{"image": "0.png"}]}, "view 0: base_from_flange"),
        ({"views": [{"base_from_flange": np.eye(4).tolist()}]}, "view 0: must be an object with 'image'"),
        ({"width": 320}, "640 x 480 pixels; the lens is of 320 x 480"),
    ],
)
def test_what_is_wrong_with_the_poses_is_said(capture: Path, change: dict[str, object], words: str):
    data = json.loads((capture / "robot.json").read_text())
    file = capture / "wrong.json"
    file.write_text(json.dumps({**data, **change}))
    with pytest.raises(InputError, match=words):
        sightings_of(Calibrate(file))
