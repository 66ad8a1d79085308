"""`neugrasp calibrate` on drawn photos of a board."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from board_capture import CAMERA, write_board_photos
from neugrasp.errors import InputError
from neugrasp.geometry.pose import rigid
from neugrasp.operation.calibrate import run, sightings_of
from neugrasp.operation.command import Calibrate

pytestmark = pytest.mark.skipif(find_spec("cv2") is None, reason="needs neugrasp[capture]")


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("capture")
    write_board_photos(folder)
    return folder


@pytest.mark.slow
def test_the_pose_is_found_and_said_as_a_cell_file_has_it(capture: Path):
    said = run(Calibrate(capture / "robot.json"))
    assert said.exit_code == 0
    (line,) = [line for line in said.text.splitlines() if line.startswith("flange_from_camera = ")]
    position = [float(x) for x in line.split("[")[1].split("]")[0].split(",")]
    np.testing.assert_allclose(position, CAMERA[:3, 3], atol=1.5e-3)
    assert "closed forms: Tsai" in said.text
    assert said.text.splitlines()[-1] == "next: neugrasp cell check CELL.toml"


@pytest.mark.slow
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


Change = Callable[[list[np.ndarray]], list[np.ndarray]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda poses: [np.diag([1000.0, 1000, 1000, 1]) @ pose for pose in poses], "looks like millimetres"),
        (lambda poses: [*poses[1:], poses[0]], "in the same order|spreads by [1-9][0-9]"),
        (lambda poses: [poses[0]] * len(poses), "hardly turns"),
        (
            lambda poses: [np.linalg.inv(pose) for pose in poses],
            "looks like flange_from_base: write the inverse",
        ),
    ],
    ids=["millimetres", "of the photo before", "all alike", "inverted"],
)
def test_poses_that_are_not_those_of_the_photos_are_told(capture: Path, change: Change, words: str):
    data = json.loads((capture / "robot.json").read_text())
    poses = change([np.array(view["base_from_flange"]) for view in data["views"]])
    for view, pose in zip(data["views"], poses, strict=True):
        turn, place = pose[:3, :3] / np.linalg.norm(pose[:3, 0]), pose[:3, 3]
        view["base_from_flange"] = rigid(turn, place).tolist()
    file = capture / "changed.json"
    file.write_text(json.dumps(data))
    assert re.search(words, told(file))


def told(file: Path) -> str:
    """What is weak, or why there is nothing."""
    try:
        said = run(Calibrate(file))
    except InputError as error:
        return str(error)
    return said.text if said.exit_code else ""


def test_one_photo_for_all_poses_is_no_calibration(capture: Path):
    data = json.loads((capture / "robot.json").read_text())
    file = capture / "one.json"
    file.write_text(json.dumps({**data, "views": [{**view, "image": "0.png"} for view in data["views"]]}))
    with pytest.raises(InputError, match=r"the photo 0\.png is there twice"):
        run(Calibrate(file))
