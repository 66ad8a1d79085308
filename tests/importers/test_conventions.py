"""Poses in another convention are called what they are, in terms of the file that the user has."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Picture

from foreign_formats import (
    FLANGE_FROM_CAMERA,
    OPENGL,
    Similarity,
    write_colmap,
    write_nerfstudio,
    write_robot,
)
from neugrasp.geometry.pose import Array, inverse, rigid, to_quaternion
from neugrasp.observation import View, Views
from patterned_table import edited, imported, patterned_views

LINK_FROM_OPTICAL = rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])


@pytest.fixture(scope="module")
def views() -> Views:
    return patterned_views()


@pytest.mark.slow
def test_the_right_poses_are_taken(views: Views, tmp_path: Path):
    for name, source in (
        ("nerfstudio", write_nerfstudio(tmp_path / "a", views, Similarity())),
        ("colmap", write_colmap(tmp_path / "b", views, Similarity(), is_binary=True)),
        ("robot", write_robot(tmp_path / "c", views)),
    ):
        (tmp_path / name).mkdir()
        assert imported(tmp_path / name, [name, str(source)], views) == 0


FRAMES = {
    "OpenCV axes": (lambda pose: pose @ OPENGL, "transform_matrix holds OpenCV axes"),
    "the inverse": (inverse, "transform_matrix holds world-to-camera; transforms.json wants"),
    "OpenCV's inverse": (
        lambda pose: inverse(pose @ OPENGL),
        "transform_matrix holds world-to-camera with OpenCV axes",
    ),
}


@pytest.mark.parametrize("mistake", FRAMES)
def test_conventions_of_transforms_json(
    views: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str], mistake: str
):
    change, words = FRAMES[mistake]

    def edit(data: dict[str, Any]) -> None:
        for frame in data["frames"]:
            frame["transform_matrix"] = change(np.array(frame["transform_matrix"])).tolist()

    file = edited(write_nerfstudio(tmp_path / "a", views, Similarity()), edit)
    assert imported(tmp_path, ["nerfstudio", str(file)], views) == 2
    error = capsys.readouterr().err
    assert words in error
    assert "transforms.json: the cameras do not look down at the workspace" in error
    assert "world_from_camera" not in error
    assert "; or: " not in error


IMAGES: dict[str, tuple[Callable[[Array], Array], Callable[[Array], Array], str]] = {
    "camera to world": (inverse, to_quaternion, "holds camera-to-world poses; COLMAP's poses are"),
    "OpenGL, camera to world": (
        lambda pose: inverse(pose) @ OPENGL,
        to_quaternion,
        "holds camera-to-world poses with OpenGL axes",
    ),
    "OpenGL": (lambda pose: OPENGL @ pose, to_quaternion, "has poses with OpenGL axes"),
    "x first": (lambda pose: pose, lambda pose: to_quaternion(pose)[[1, 2, 3, 0]], "order x, y, z, w"),
}


@pytest.mark.parametrize("mistake", IMAGES)
def test_conventions_of_colmap(
    views: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str], mistake: str
):
    change, quaternion, words = IMAGES[mistake]
    model = write_colmap(tmp_path / "a", views, Similarity(), is_binary=False)
    lines = []
    for i, view in enumerate(views.frames):
        pose = change(inverse(view.camera.world_from_camera))
        x, y, z, w = quaternion(pose)
        lines += [f"{i + 1} {w} {x} {y} {z} {' '.join(map(str, pose[:3, 3]))} {i + 1} view_{i}.png", ""]
    (model / "images.txt").write_text("\n".join(lines))
    assert imported(tmp_path, ["colmap", str(model)], views) == 2
    error = capsys.readouterr().err
    assert f"images.txt {words}" in error or ("images.txt has quaternions" in error and words in error)
    assert "; or: " not in error


def quaternion_first(pose: Array) -> dict[str, Any]:
    x, y, z, w = to_quaternion(pose).tolist()
    return {"position": pose[:3, 3].tolist(), "quaternion_xyzw": [w, x, y, z]}


def millimetres(pose: Array) -> Array:
    return rigid(pose[:3, :3], 1000 * pose[:3, 3])


def tool(length: float) -> Array:
    return rigid(translation=(0, 0, length))


POSES: dict[str, tuple[Callable[[Array], Any], Callable[[Array], Any], str]] = {
    "hand-eye inverse": (inverse, np.array, "flange_from_camera looks like camera_from_flange"),
    "flange inverse": (np.array, inverse, "base_from_flange looks like flange_from_base"),
    "camera_link": (
        lambda pose: pose @ inverse(LINK_FROM_OPTICAL),
        np.array,
        "flange_from_camera ends in ROS's camera_link",
    ),
    "millimetres": (
        millimetres,
        millimetres,
        "base_from_flange and flange_from_camera look like millimetres",
    ),
    "flange millimetres": (np.array, millimetres, "; base_from_flange looks like millimetres"),
    "hand-eye millimetres": (millimetres, np.array, "; flange_from_camera looks like millimetres"),
    "OpenGL": (lambda pose: pose @ OPENGL, np.array, "flange_from_camera has OpenGL axes"),
    "hand-eye wxyz": (
        quaternion_first,
        np.array,
        "flange_from_camera: the quaternion looks like (w, x, y, z)",
    ),
    "flange wxyz": (np.array, quaternion_first, "base_from_flange: the quaternions look like (w, x, y, z)"),
    "tool of 103 mm": (np.array, lambda pose: pose @ tool(0.1034), "a tool's tip (TCP), 10[0-9] mm beyond"),
    "tool of 60 mm": (np.array, lambda pose: pose @ tool(0.06), "a tool's tip (TCP), (58|60|62) mm beyond"),
}


@pytest.mark.slow
@pytest.mark.parametrize("mistake", POSES)
def test_conventions_of_a_robot(
    views: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str], mistake: str
):

    hand_eye, flange, words = POSES[mistake]

    def written(value: Any) -> Any:
        return value if isinstance(value, dict) else value.tolist()

    def edit(data: dict[str, Any]) -> None:
        data["flange_from_camera"] = written(hand_eye(FLANGE_FROM_CAMERA))
        for entry in data["views"]:
            entry["base_from_flange"] = written(flange(np.array(entry["base_from_flange"])))

    file = edited(write_robot(tmp_path / "a", views), edit)
    assert imported(tmp_path, ["robot", str(file)], views) == 2
    error = capsys.readouterr().err
    pattern = words.replace("(TCP)", r"\(TCP\)").replace("(w, x, y, z)", r"\(w, x, y, z\)")
    assert re.search(pattern, error), error
    assert "; or: " not in error


def test_an_eye_beside_the_robot_is_called_so(
    views: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """It takes the same photo wherever the arm is."""
    first = views.frames[0]
    file = write_robot(tmp_path / "a", views)
    for i in range(4):
        for kind in ("images", "backgrounds"):
            Picture.fromarray(first.image).save(tmp_path / "a" / kind / f"view_{i}.png")
    edited(file, lambda data: data.update(flange_from_camera=first.camera.world_from_camera.tolist()))
    assert imported(tmp_path, ["robot", str(file)], views) == 2
    assert "looks like base_from_camera, of a camera beside the robot" in capsys.readouterr().err


@pytest.mark.slow
def test_a_table_without_a_pattern_accuses_nobody(views: Views, tmp_path: Path):
    grey = np.full((120, 160, 3), 127, dtype=np.uint8)
    plain = Views(tuple(View(view.camera, grey, grey) for view in views.frames), views.workspace)

    def edit(data: dict[str, Any]) -> None:
        for entry in data["views"]:
            entry["base_from_flange"] = (np.array(entry["base_from_flange"]) @ tool(0.06)).tolist()

    file = edited(write_robot(tmp_path / "a", plain), edit)
    assert imported(tmp_path, ["robot", str(file)], plain) == 0
