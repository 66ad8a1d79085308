"""Whatever is done to a file that a user hands in: a scene or one clear error comes, nothing else."""

from __future__ import annotations

import contextlib
import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from foreign_formats import Similarity, write_colmap, write_nerfstudio, write_robot
from mutations import as_json, spoilt, spoilt_bytes, spoilt_text
from neugrasp.data.scene_folder import read_scene, write_scene
from neugrasp.data.strict_json import read_object
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import look_at
from neugrasp.geometry.workspace import Workspace
from neugrasp.importers.alignment import read_alignment
from neugrasp.importers.board_file import read_board
from neugrasp.importers.colmap import read_model
from neugrasp.importers.mistakes import check_poses
from neugrasp.importers.nerfstudio import check_motion, read_transforms
from neugrasp.importers.photos import Pair
from neugrasp.importers.posed_image import Listed
from neugrasp.importers.robot_poses import camera_of, read_robot
from neugrasp.observation import View, Views

FEW, MANY = 100, 2000
BOARDS = [
    {
        "kind": "charuco",
        "columns": 7,
        "rows": 5,
        "square": 0.036,
        "marker": 0.027,
        "dictionary": "DICT_4X4_50",
    },
    {
        "kind": "tags",
        "dictionary": "DICT_APRILTAG_36h11",
        "upright": "official",
        "tags": [{"id": 0, "size": 0.05, "centre": [0.1, 0.2], "turn_deg": 30}, {"id": 1, "size": 0.04}],
        "board_from_workspace": {"position": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1.0]},
    },
]
CAMERAS = [
    {
        "K": [[500.0, 0, 320], [0, 500, 240], [0, 0, 1]],
        "D": [0.1, 0, 0, 0, 0],
        "image_width": 640,
        "image_height": 480,
    },
    {
        "intrinsics": {
            "fx": 500.0,
            "fy": 500,
            "ppx": 320,
            "ppy": 240,
            "width": 640,
            "height": 480,
            "coeffs": [0.0] * 5,
        }
    },
]


def small_scene() -> Views:
    """Two photos of 32 pixels."""
    photo = np.zeros((32, 32, 3), dtype=np.uint8)
    intrinsics = np.array([[30.0, 0, 16], [0, 30, 16], [0, 0, 1]])
    poses = [look_at((x, -0.2, 0.5), (0.15, 0.15, 0.05)) for x in (0.1, 0.2)]
    return Views(tuple(View(Camera(intrinsics, pose, 32, 32), photo, photo) for pose in poses), Workspace())


def read_all(listed: list[Listed], file: Path) -> None:
    """All of the posed images, and what is said of their poses."""
    photo = next(above / "images/view_0.png" for above in file.parents if (above / "images").is_dir())
    posed_images = [entry.read() for entry in listed]
    check_poses(posed_images, {posed.name: Pair(photo, photo) for posed in posed_images}, Workspace(), "here")


def transforms(file: Path) -> None:
    check_motion(file, has_scale=False, has_place=False)
    read_all(read_transforms(file, lambda _: (32, 32)), file)


def camera(file: Path) -> None:
    camera_of(read_object(file, "a camera"), file)


def board(file: Path) -> None:
    read_board(str(file))


def scene(file: Path) -> None:
    read_scene(file)


def robot(file: Path) -> None:
    read_all(read_robot(file), file)


def model(file: Path) -> None:
    read_all(read_model(file.parent), file)


def poses(file: Path) -> None:
    robot(file.parent / "robot.json")


def alignment(file: Path) -> None:
    read_alignment(file)


READERS: dict[str, tuple[Callable[[Path], None], str]] = {
    "scene": (scene, "scene.json"),
    "transforms": (transforms, "transforms.json"),
    "robot": (robot, "robot.json"),
    "alignment": (alignment, "alignment.json"),
    **{f"board {i}": (board, f"board{i}.json") for i in range(len(BOARDS))},
    **{f"camera {i}": (camera, f"camera{i}.json") for i in range(len(CAMERAS))},
}


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one good file of every kind."""
    folder = tmp_path_factory.mktemp("good")
    views = small_scene()
    write_scene(folder, views)
    write_nerfstudio(folder, views, Similarity())
    write_robot(folder, views)
    write_robot(folder / "csv", views, is_csv=True)
    write_colmap(folder / "colmap", views, Similarity(), is_binary=False)
    write_colmap(folder / "binary", views, Similarity(), is_binary=True)
    Similarity().write(folder / "alignment.json", views)
    for i, data in enumerate(BOARDS):
        (folder / f"board{i}.json").write_text(json.dumps(data))
    for i, data in enumerate(CAMERAS):
        (folder / f"camera{i}.json").write_text(json.dumps(data))
    for read, name in READERS.values():
        read(folder / name)
    robot(folder / "csv/robot.json")
    model(folder / "colmap/sparse/0/images.txt")
    return folder


def survive(read: Callable[[Path], None], file: Path, content: bytes) -> None:
    """Reads the file with another content, and puts it back."""
    original = file.read_bytes()
    file.write_bytes(content)
    try:
        with contextlib.suppress(InputError), warnings.catch_warnings():
            warnings.simplefilter("error")
            read(file)
    finally:
        file.write_bytes(original)


def fuzz(strategy: st.SearchStrategy[bytes], read: Callable[[Path], None], file: Path, count: int) -> None:
    """As many spoilt contents of the strategy."""

    @settings(
        max_examples=count,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
        derandomize=True,
    )
    @given(strategy)
    def each(content: bytes) -> None:
        survive(read, file, content)

    each()


counts = pytest.mark.parametrize(
    "count", [FEW, pytest.param(MANY, marks=[pytest.mark.slow, pytest.mark.timeout(1800)])]
)


@pytest.mark.slow
@counts
@pytest.mark.parametrize("kind", READERS)
def test_no_json_ends_in_anything_but_a_result_or_an_input_error(good: Path, kind: str, count: int):
    read, name = READERS[kind]
    document: dict[str, Any] = json.loads((good / name).read_text())
    fuzz(spoilt(document).map(as_json), read, good / name, count)


@pytest.mark.slow
@counts
@pytest.mark.parametrize("kind", ["scene", "transforms", "robot"])
def test_no_text_of_a_json_file_does(good: Path, kind: str, count: int):
    read, name = READERS[kind]
    fuzz(spoilt_text((good / name).read_text()), read, good / name, count)


@pytest.mark.slow
@counts
@pytest.mark.parametrize("name", ["cameras", "images"])
def test_no_text_of_a_colmap_model_does(good: Path, name: str, count: int):
    file = good / "colmap/sparse/0" / f"{name}.txt"
    fuzz(spoilt_text(file.read_text()), model, file, count)


@pytest.mark.slow
@counts
@pytest.mark.parametrize("name", ["cameras", "images"])
def test_no_bytes_of_a_colmap_model_do(good: Path, name: str, count: int):
    file = good / "binary/sparse/0" / f"{name}.bin"
    fuzz(spoilt_bytes(file.read_bytes()), model, file, count)


@pytest.mark.slow
@counts
def test_no_text_of_a_csv_file_does(good: Path, count: int):
    file = good / "csv/poses.csv"
    fuzz(spoilt_text(file.read_text()), poses, file, count)
