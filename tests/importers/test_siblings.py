"""Other inputs of the kinds that once failed without a word: each is understood, or refused by name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foreign_formats import Similarity, write_nerfstudio
from neugrasp.errors import InputError
from neugrasp.importers.alignment import read_alignment
from neugrasp.importers.board_file import read_board
from neugrasp.importers.files import pose_of
from neugrasp.importers.nerfstudio import check_motion, read_transforms
from neugrasp.importers.robot_poses import camera_of, read_robot
from neugrasp.observation import Views

MATRIX = [[520.0, 0, 321.0], [0, 524.0, 237.0], [0, 0, 1]]
BENDS = [-0.18, 0.05, 0.001, -0.002, 0.01]
SIZE = {"width": 640, "height": 480}
OURS: dict[str, Any] = {"intrinsics": MATRIX, **SIZE}
FOCAL = {"fx": 520.0, "fy": 524.0}


def lens(entry: dict[str, Any]) -> Any:
    return camera_of(entry, Path("camera.json"))


@pytest.mark.parametrize(
    "point",
    [
        {"principal_point": [321.0, 237.0]},
        {"principalPoint": {"rows": 1, "cols": 2, "data": [321.0, 237.0]}},
        {"pp": [321.0, 237.0]},
        {"optical_center": [321.0, 237.0]},
        {"u0": 321.0, "v0": 237.0},
        {"center_x": 321.0, "center_y": 237.0},
        {"principal_x": 321.0, "principal_y": 237.0},
    ],
    ids=lambda point: next(iter(point)),
)
@pytest.mark.parametrize("is_nested", [False, True], ids=["plain", "nested"])
def test_a_principal_point_under_every_name(
    point: dict[str, Any], is_nested: bool, caplog: pytest.LogCaptureFixture
):
    said = {**FOCAL, **point}
    found = lens({"intrinsics": said, **SIZE} if is_nested else {**said, **SIZE})
    np.testing.assert_array_equal(found.intrinsics, MATRIX)
    assert "not known" not in caplog.text


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"principal_point": [300.0, 237.0]}, "'principal_point' and 'intrinsics' say different"),
        ({"x0": 321.0, "y0": 237.0}, "'x0' may be a principal point; write 'cx' and 'cy'"),
        ({"center": [321.0, 237.0]}, "'center' may be a principal point"),
        ({"intrinsics": {**FOCAL, "px": 321.0, "py": 237.0}}, "'px' may be a principal point"),
        ({"intrinsics": {**FOCAL, "middle": [321.0, 237.0]}}, "'middle' within a lens is not understood"),
        ({"intrinsics": {"fx": 520, "fy": 524, "cx": 0.5, "cy": 0.5}}, "normalised"),
        ({"distortion": {"model": "opencv", "params": BENDS}}, "'params' within a lens is not understood"),
        ({"distortion": {"values": BENDS}}, "'values' within a lens is not understood"),
        ({"calibration": {"distortion": BENDS}}, "calibration: 'distortion' is a coefficient"),
        ({"camera_info": {"D": BENDS}}, "camera_info: 'D' is a coefficient"),
        ({"cameras": [{"k1": 0.1}]}, "cameras: 'k1' is a coefficient"),
        ({"camera": {"model": "fisheye"}}, "camera: 'model' is a lens that is no pinhole"),
        ({"metadata": {"applied_scale": 0.8}}, "metadata: 'applied_scale' is a scale"),
        ({"dist_k1": 0.1}, "'dist_k1' is a coefficient"),
        ({"radial_k1": 0.1}, "'radial_k1' is a coefficient"),
        ({"kappa1": 0.1}, "'kappa1' is a coefficient"),
        ({"zoom": 2.0}, "'zoom' is a change of the photo"),
        ({"rotation": 90}, "'rotation' is a change of the photo"),
        ({"exif_orientation": 6}, "'exif_orientation' is a change of the photo"),
        ({"image_scale": 0.5}, "'image_scale' is a change of the photo"),
        ({"sensor_crop": [1, 2, 3, 4]}, "'sensor_crop' is a change of the photo"),
        ({"calibration_width": 1280}, "'calibration_width' is a change of the photo"),
        ({"skew": 20.0}, "'skew' is a change of the photo"),
        ({"K": np.transpose(MATRIX).tolist()}, "say the same differently"),
        ({"intrinsics": np.transpose(MATRIX).tolist()}, "not a camera matrix without skew"),
        ({"intrinsics": [520, 524, 321, 237]}, "of another shape or type"),
        ({"intrinsics": {"fx": -520.0, "fy": 524.0}}, "'fx' is -520; it must be positive"),
    ],
)
def test_what_a_lens_says_otherwise_is_refused(more: dict[str, Any], message: str):
    with pytest.raises(InputError, match=message):
        lens({**OURS, **more})


def test_the_depth_cameras_lens_and_what_is_no_lens_are_left_out():
    more = {"depth_camera": {"D": BENDS}, "header": {"seq": 3}, "gripper": {"k1": 3}, "k1": 0}
    assert not lens({**OURS, **more}).is_distorted
    real = {"intrinsics": {**FOCAL, "cx": 321.0, "cy": 237.0, "fps": 30, "serial_number": "8", "name": "c"}}
    np.testing.assert_array_equal(lens({**real, **SIZE}).intrinsics, MATRIX)


def test_letters_of_full_width_are_letters():
    assert lens({**OURS, "\uff4b\uff11": 0.1}).radial[0] == 0.1


@pytest.mark.parametrize(
    "name",
    ["ucm", "EUCM", "KB8", "kb4", "ds", "OCamCalib", "Scaramuzza", "atan", "poly", "MEI", "wide angle"],
)
@pytest.mark.parametrize("key", ["model", "camera_model", "distortion_model"])
def test_lenses_of_other_programs_are_no_pinholes(name: str, key: str):
    with pytest.raises(InputError, match="cannot be undistorted"):
        lens({**OURS, key: name, "D": [0.1, 0, 0, 0]})


@pytest.mark.parametrize("said", [{"x_fov": 1.0}, {"fov_x": 0.9, "fov_y": 0.7}, {"fov_y": 3.9}])
def test_a_field_of_view_in_radians_is_none_in_degrees(said: dict[str, float]):
    with pytest.raises(InputError, match="it must be in degrees"):
        lens({**said, **SIZE})


POSE = {"position": [0.1, 0.2, 0.3], "quaternion_xyzw": [0.0, 0, 0, 1]}


@pytest.mark.parametrize(
    "more",
    [
        {"rpy": [1.57, 0, 0]},
        {"euler_deg": [90, 0, 0]},
        {"rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]]},
        {"quaternion_wxyz": [1, 0, 0, 0]},
        {"translation": [1, 2, 3]},
        {"tcp_offset": [0, 0, 0.1]},
        {"inverse": True},
        {"unit": "mm"},
        {"scale": 2},
        {"convention": "opengl"},
    ],
    ids=lambda more: next(iter(more)),
)
def test_a_pose_says_nothing_that_is_left_out(more: dict[str, Any]):
    with pytest.raises(InputError, match=f"here: .*{next(iter(more))!r}"):
        pose_of({**POSE, **more}, "here")
    remarks = {"frame_id": "base", "comment": "by hand", "_from": 3}
    np.testing.assert_array_equal(pose_of({**POSE, **remarks}, "here"), pose_of(POSE, "here"))


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"square_length": 0.05, "marker_length": 0.0375}, "'square_length' is not known"),
        ({"squares_x": 9, "squares_y": 6}, "'squares_x' is not known"),
        ({"Columns": 9}, "'Columns' is not known; did you mean 'columns'"),
        ({"cols": 9}, "'cols' is not known; did you mean 'columns'"),
        ({"aruco_dict": "DICT_5X5_50"}, "'aruco_dict' is not known"),
        ({"legacy_pattern": True}, "'legacy_pattern' is not known"),
        ({"printed_scale": 0.97}, "'printed_scale' is not known"),
        ({"first_id": 20}, "'first_id' is not known"),
        ({"kind": "tags", "tags": [{"id": 0, "size": 0.05}], "family": "tag25h9"}, "'family' is not known"),
        ({"kind": "tags", "tags": [{"id": 0, "size": 0.05, "x": 0.1}]}, "tag 0: the key 'x' is not known"),
        ({"kind": "tags", "tags": [{"id": 0, "size": 0.05, "border": 0.01}]}, "'border' is not known"),
        ({"kind": "tags", "tags": [{"id": 0, "size": 0.05, "turnDeg": 90}]}, "did you mean 'turn_deg'"),
        ({"kind": "tags", "tags": [{"id": 0, "size": 0.05, "rot": 90}]}, "'rot' is not known"),
    ],
)
def test_a_measure_of_a_board_under_another_name_is_refused(
    tmp_path: Path, more: dict[str, Any], message: str
):
    file = tmp_path / "board.json"
    file.write_text(json.dumps({"kind": "charuco", "comment": "on foam", **more}))
    with pytest.raises(InputError, match=message):
        read_board(str(file))


@pytest.mark.parametrize(
    "key",
    [
        *(
            "meters_per_unit",
            "Metres_Per_Unit",
            "mm_per_unit",
            "units_per_metre",
            "metric_scale",
            "transform",
        ),
        *("reconstruction_from_world", "world_to_reconstruction", "world_from_colmap", "workspace_size"),
    ],
)
def test_a_scale_or_a_place_under_another_name_is_refused(tmp_path: Path, key: str):
    file = tmp_path / "alignment.json"
    value: Any = 0.25 if "from" not in key and "_to_" not in key else np.diag([1.0, -1, -1, 1]).tolist()
    file.write_text(json.dumps({"world_from_workspace": np.eye(4).tolist(), key: value, "name": "a"}))
    with pytest.raises(InputError, match=f"alignment.json: .*{key!r}"):
        read_alignment(file)


@pytest.mark.parametrize(
    ("more", "key"),
    [
        ({"scene_scale_factor": 0.8}, "scene_scale_factor"),
        ({"pose_scale_factor": 0.8}, "pose_scale_factor"),
        ({"unit_scale": 0.001}, "unit_scale"),
        ({"scale_mat_0": np.diag([2.0, 2, 2, 1]).tolist()}, "scale_mat_0"),
        ({"metres_per_unit": 0.25}, "metres_per_unit"),
        ({"appliedScale": 0.8}, "appliedScale"),
        ({"pose_transform": np.diag([1.0, -1, -1, 1]).tolist()}, "pose_transform"),
        ({"dataparser": {"applied_scale": 0.8}}, "applied_scale"),
        ({"w2c": True}, "w2c"),
        ({"is_world_to_camera": True}, "is_world_to_camera"),
        ({"mirror": True}, "mirror"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_moved_the_poses_of_transforms_json_is_refused(
    tmp_path: Path, small_views: Views, more: dict[str, Any], key: str
):
    file = write_nerfstudio(tmp_path, small_views, Similarity())
    file.write_text(json.dumps({**json.loads(file.read_text()), **more}))
    check_motion(file, has_scale=False, has_place=False)
    with pytest.raises(InputError, match=f"{key!r} is a"):
        [entry.read() for entry in read_transforms(file, lambda _: (64, 36))]


HEAD, LINE = "image,x,y,z,qx,qy,qz,qw", "0.png,.1,.2,.3,0,0,0,1"


def poses(folder: Path, head: str, line: str, views: str = "poses.csv") -> list[Any]:
    robot = {**OURS, "flange_from_camera": np.eye(4).tolist(), "views": views}
    (folder / "robot").mkdir()
    (folder / "robot/robot.json").write_text(json.dumps(robot))
    (folder / "robot" / views).write_text(f"{head}\n{line}\n", encoding="utf-8")
    return read_robot(folder / "robot/robot.json")


@pytest.mark.parametrize(
    ("head", "line", "message"),
    [
        (HEAD + ",rx,ry,rz", LINE + ",0,0,1", "the column 'qx' says what rx, ry, rz say"),
        (HEAD + ",roll,pitch,yaw", LINE + ",90,0,0", "the column 'roll' says what"),
        (HEAD + ",tcp_offset_z", LINE + ",.1", "the column 'tcp_offset_z' says what"),
        (HEAD + ",Yaw_deg", LINE + ",90", "the column 'Yaw_deg' says what"),
        (HEAD.replace(",", ";"), LINE.replace(",", ";"), "no column image"),
        (HEAD.upper(), LINE, "no column image"),
        (HEAD.replace("x,y,z", "x [mm],y [mm],z [mm]", 1), LINE, "no column x, y, z"),
        (HEAD, LINE.replace(".1", "inf"), "contains NaN or infinity"),
        (HEAD, "[-],m,m,m,-,-,-,-", "of another shape or type"),
    ],
)
def test_columns_that_say_another_pose_are_refused(tmp_path: Path, head: str, line: str, message: str):
    with pytest.raises(InputError, match=message):
        [entry.read() for entry in poses(tmp_path, head, line)]


@pytest.mark.parametrize("name", ["../images/0.png", "..\\images\\0.png", "Ä ö.png", "/x/0.png", "C:\\0.png"])
@pytest.mark.parametrize("views", ["poses.csv", "../poses.csv", "Posés 1.CSV"])
def test_tables_and_photos_may_lie_beside(tmp_path: Path, name: str, views: str):
    (entry,) = poses(tmp_path, HEAD, LINE.replace("0.png", name), views)
    assert entry.name == name
    np.testing.assert_allclose(entry.read().world_from_camera[:3, 3], [0.1, 0.2, 0.3])


def test_the_order_of_columns_is_free(tmp_path: Path):
    (entry,) = poses(tmp_path, "qw,qx,qy,qz,z,y,x,image", "1,0,0,0,.3,.2,.1,0.png")
    np.testing.assert_allclose(
        entry.read().world_from_camera[:3], np.eye(4)[:3] + [[0, 0, 0, 0.1 * i] for i in (1, 2, 3)]
    )
