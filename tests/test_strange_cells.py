"""What describes cells, and what comes from them, damaged at random: it is read, or refused in one line."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from damage import damaged_bytes, damaged_json, fuzz, many
from neugrasp.data.strict_json import parse_json
from neugrasp.robot.cell_file import CellFile, read_cell
from neugrasp.ros.messages import Transforms, intrinsics_of, photo_of
from neugrasp.ros.parameters import read_parameters, write_parameters
from robot_cells import TWIN

PHOTO = np.zeros((12, 16, 3), np.uint8)
IMAGE = {
    "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "optical"},
    "height": 12,
    "width": 16,
    "encoding": "bgr8",
    "is_bigendian": 0,
    "step": 48,
    "data": base64.b64encode(PHOTO.tobytes()).decode(),
}
INFO = {
    "height": 12,
    "width": 16,
    "d": [0.0, 0.0, 0.0, 0.0, 0.0],
    "k": [20.0, 0.0, 7.5, 0.0, 20.0, 5.5, 0.0, 0.0, 1.0],
    "p": [20.0, 0.0, 7.5, 0.0, 0.0, 20.0, 5.5, 0.0, 0.0, 0.0, 1.0, 0.0],
    "binning_x": 0,
    "roi": {"x_offset": 0, "y_offset": 0},
}
TREE = {
    "transforms": [
        {
            "header": {"frame_id": "base"},
            "child_frame_id": "optical",
            "transform": {
                "translation": {"x": 0.1, "y": 0.2, "z": 0.3},
                "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            },
        }
    ]
}


def check_cell(cell: CellFile) -> None:
    for pose in (cell.camera.flange_from_camera, cell.gripper.flange_from_hand):
        assert np.all(np.isfinite(pose))
        assert np.linalg.norm(pose[:3, 3]) < 1
    for joints in (cell.drop, cell.out_of_sight):
        assert joints.shape == (6,)
        assert np.all(np.isfinite(joints))
    assert 0 < cell.approach_speed <= 0.5


@many
def test_a_cell(examples: int, tmp_path: Path):
    file = tmp_path / "cell.toml"

    def read(content: bytes) -> None:
        file.write_bytes(content)
        check_cell(read_cell(file))

    fuzz(read, damaged_bytes(TWIN.read_bytes()), examples)


@many
def test_parameters_of_a_node(examples: int, tmp_path: Path):
    file = tmp_path / "node.json"
    write_parameters(file)
    right = json.loads(file.read_text())

    def read(text: str) -> None:
        file.write_text(text, encoding="utf-8")
        given = read_parameters(file)
        assert all(isinstance(name, str) for name in given.finger_joints)
        assert np.all(np.isfinite(given.workspace.world_from_workspace))

    fuzz(read, damaged_json(right), examples)


def said(read: Callable[[Any], Any]) -> Callable[[str], Any]:
    """As a node takes a message."""
    return lambda text: read(parse_json(text, "a message", judges_values=False))


@many
def test_messages_of_cameras(examples: int):
    raw = IMAGE | {"data": list(PHOTO[:1].tobytes()), "height": 1}
    for right in (IMAGE, raw):
        fuzz(said(lambda it: photo_of(it, "/image", False)), damaged_json(right), examples // 3)
    fuzz(said(lambda it: photo_of(it, "/image", True)), damaged_json(IMAGE), examples // 3)
    for is_rectified in (True, False):

        def read(it: Any, is_rectified: bool = is_rectified) -> None:
            assert np.all(np.isfinite(intrinsics_of(it, "/info", PHOTO, is_rectified)))

        fuzz(said(read), damaged_json(INFO), examples // 2)


@many
def test_messages_of_transforms(examples: int):
    def read(it: Any) -> None:
        transforms = Transforms()
        transforms.take(it)
        pose = transforms.pose("base", "optical")
        assert pose is None or np.all(np.isfinite(pose))

    fuzz(said(read), damaged_json(TREE), examples)
