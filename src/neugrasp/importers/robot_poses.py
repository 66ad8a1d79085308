"""Photos from a camera on a robot's flange: poses of the flange, hand-eye calibration, one lens.

The file `robot.json`:

    {"intrinsics": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "width": 640, "height": 480,
     "distortion": [k1, k2, p1, p2, k3],
     "flange_from_camera": POSE,
     "views": [{"image": "0.png", "base_from_flange": POSE}, ...]}

A POSE is a 4 x 4 matrix, {"position": [x, y, z], "quaternion_xyzw": [x, y, z, w]}, or {"position": [x, y, z],
"rotation_vector": [rx, ry, rz]} as Universal Robots write it, metres and radians. `views` may instead name a
CSV file beside it with the columns image, x, y, z, and qx, qy, qz, qw or rx, ry, rz. A view may also have
`background_base_from_flange`, where its background was taken from a slightly different pose. The camera's
axes are OpenCV's, pixel centres lie at integers (as OpenCV calibrates), and the world is the robot's base.
"""

from __future__ import annotations

import csv
import io
import logging
import re
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.known_keys import refuse_bends, warn_of_unknown
from neugrasp.data.spelling import plain
from neugrasp.data.strict_json import read_object
from neugrasp.data.user_files import check_name, read_text
from neugrasp.errors import InputError
from neugrasp.geometry.lens import Lens
from neugrasp.geometry.pose import Array, from_quaternion, inverse, rigid
from neugrasp.importers.files import pose_of
from neugrasp.importers.foreign_lens import lens_of
from neugrasp.importers.lens_keys import LENS_KEYS, check_lens_keys, is_lens_key
from neugrasp.importers.posed_image import Listed, PosedImage

COLUMNS = ("image", "x", "y", "z", "qx", "qy", "qz", "qw")
VECTOR_COLUMNS = ("image", "x", "y", "z", "rx", "ry", "rz")
"""As Universal Robots write poses: a rotation vector."""
SECOND_POSE = re.compile(r"[qr][wxyz]|roll\w*|pitch\w*|yaw\w*|(tcp|tool|flange)?offset\w*|t[xyz]")
"""Columns, in plain letters, that turn or move a pose besides those that are read."""
FILE_KEYS = ("flange_from_camera", "views", *LENS_KEYS)
VIEW_KEYS = ("image", "base_from_flange", "background_base_from_flange", *LENS_KEYS)
CAMERA_KEYS = (*LENS_KEYS, "camera_name", "projection_matrix", "P", "header", "R", "rectification_matrix")
LINK_FROM_OPTICAL = rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""ROS: x forward, y left, z up; from z forward, x right, y down."""

logger = logging.getLogger(__name__)


def read_robot(file: Path) -> list[Listed]:
    """world_from_camera = base_from_flange @ flange_from_camera for every view. Raises `InputError`."""
    data, rows = flange_views(file)
    hand_eye = pose_of(data.get("flange_from_camera"), f"{file}: flange_from_camera")
    if np.allclose(hand_eye, np.eye(4), atol=1e-6):
        logger.warning(
            "%s: flange_from_camera is the identity, which is right only where base_from_flange holds "
            "poses of the camera itself; `neugrasp calibrate` finds it",
            file,
        )
    return [_listed(data, entry, where) for entry, where in rows]


def flange_views(file: Path) -> tuple[dict[str, Any], list[tuple[dict[str, Any], str]]]:
    """What a list of flange poses says of all its views, and the views, each with where it stands.

    Raises `InputError` naming a key that is not understood, or the view that is none.
    """
    data = read_object(file, "a list of flange poses")
    views = data.get("views")
    check_lens_keys(data, FILE_KEYS, str(file))
    if isinstance(views, str) and views:
        rows = _rows(file.parent / views)
    elif isinstance(views, list) and views:
        rows = [(entry, f"{file}, view {i}") for i, entry in enumerate(views)]
    else:
        raise InputError(f"{file}: 'views' must be a list of at least one view, or the name of a CSV file")
    objects = [entry for entry, _ in rows if isinstance(entry, dict)]
    keys = {key for entry in (data, *objects) for key in entry if is_lens_key(key)}
    warn_of_unknown([data], {*FILE_KEYS, *keys}, file, logger)
    warn_of_unknown(objects, {*VIEW_KEYS, *keys}, f"{file}, views", logger)
    for entry, where in rows:
        if not isinstance(entry, dict) or not isinstance(entry.get("image"), str) or not entry["image"]:
            raise InputError(f"{where}: must be an object with 'image' and 'base_from_flange'")
        check_name(entry["image"], f"{where}: image")
    return data, rows


def lens_of_view(data: dict[str, Any], entry: dict[str, Any], where: str) -> Lens:
    """The lens of a view, its own or the file's. Raises `InputError`, also on keys of a view that bend."""
    check_lens_keys(entry, VIEW_KEYS, where)
    return lens_of(entry, where, file=data)


def camera_of(data: dict[str, Any], file: Path) -> Any:
    """The lens of a camera's file, such as ROS's camera_info, RealSense's or Orbbec's. Raises "
    "`InputError`."""
    check_lens_keys(data, (*LENS_KEYS, "P", "projection_matrix"), str(file))
    warn_of_unknown([data], {*CAMERA_KEYS, *filter(is_lens_key, data)}, file, logger)
    return lens_of(data, str(file))


def _listed(data: dict[str, Any], entry: dict[str, Any], where: str) -> Listed:
    return Listed(entry["image"], lambda: _shot(data, entry, where))


def _shot(data: dict[str, Any], entry: dict[str, Any], where: str) -> PosedImage:
    """The view, and its background where that has a pose of its own."""
    lens = lens_of_view(data, entry, where)
    flange_from_camera = pose_of(data["flange_from_camera"], "flange_from_camera")
    base_from_flange = pose_of(entry.get("base_from_flange"), f"{where}: base_from_flange")
    world_from_background = None
    if entry.get("background_base_from_flange") is not None:
        pose = pose_of(entry["background_base_from_flange"], f"{where}: background_base_from_flange")
        world_from_background = pose @ flange_from_camera
    suspects = {
        f"{mistake} (robot.json)": pose
        for mistake, pose in _suspects(data["flange_from_camera"], entry["base_from_flange"]).items()
    }
    world_from_camera = base_from_flange @ flange_from_camera
    return PosedImage(
        entry["image"], lens, world_from_camera, world_from_background, suspects, base_from_flange[:3, 2]
    )


def _suspects(hand_eye: Any, flange: Any) -> dict[str, Array]:
    """world_from_camera after each of the usual confusions of hand-eye calibrations, undone."""
    flange_from_camera, base_from_flange = pose_of(hand_eye, ""), pose_of(flange, "")
    base_m, hand_m = _in_metres(base_from_flange), _in_metres(flange_from_camera)
    suspects = {
        "base_from_flange and flange_from_camera look like millimetres: give metres": base_m @ hand_m,
        "base_from_flange looks like millimetres: give metres": base_m @ flange_from_camera,
        "flange_from_camera looks like millimetres: give metres": base_from_flange @ hand_m,
        "flange_from_camera looks like camera_from_flange: write the inverse": base_from_flange
        @ inverse(flange_from_camera),
        "base_from_flange looks like flange_from_base: write the inverse": inverse(base_from_flange)
        @ flange_from_camera,
        "flange_from_camera looks like base_from_camera, of a camera beside the robot (eye-on-base): it must "
        "be calibrated on the flange (eye-in-hand)": flange_from_camera,
        "flange_from_camera looks like camera_from_base, of a camera beside the robot (eye-on-base): it must "
        "be calibrated on the flange (eye-in-hand)": inverse(flange_from_camera),
        "flange_from_camera ends in ROS's camera_link (x forward): give the optical frame (z forward)": (
            base_from_flange @ flange_from_camera @ LINK_FROM_OPTICAL
        ),
        "flange_from_camera has OpenGL axes: multiply by diag(1, -1, -1, 1) from the right": base_from_flange
        @ flange_from_camera
        @ np.diag([1.0, -1.0, -1.0, 1.0]),
    }
    if (turned := _reordered(hand_eye)) is not None:
        suspects["flange_from_camera: the quaternion looks like (w, x, y, z); (x, y, z, w) is wanted"] = (
            base_from_flange @ turned
        )
    if (turned := _reordered(flange)) is not None:
        suspects["base_from_flange: the quaternions look like (w, x, y, z); (x, y, z, w) is wanted"] = (
            turned @ flange_from_camera
        )
    return suspects


def _in_metres(pose: Array) -> Array:
    """What is meant by a pose in millimetres."""
    return rigid(pose[:3, :3], pose[:3, 3] / 1000)


def _reordered(value: Any) -> Array | None:
    """The pose if its quaternion is (w, x, y, z); None where it has none."""
    if not isinstance(value, dict) or "quaternion_xyzw" not in value:
        return None
    w, x, y, z = np.array(value["quaternion_xyzw"], dtype=np.float64)
    return from_quaternion([x, y, z, w], np.array(value["position"], dtype=np.float64))


def _rows(file: Path) -> list[tuple[dict[str, Any], str]]:
    """The lines of a CSV file as views, each with where it stands."""
    try:
        reader = csv.DictReader(io.StringIO(read_text(file), newline=""), skipinitialspace=True)
        names = [name.strip() for name in reader.fieldnames or ()]
        reader.fieldnames = names
        lines = list(reader)
    except FileNotFoundError:
        raise InputError(f"{file}: missing; 'views' names it") from None
    except csv.Error as error:
        raise InputError(f"{file}: no CSV file ({error})") from error
    columns = VECTOR_COLUMNS if {"rx", "ry", "rz"} & set(names) else COLUMNS
    missing = [column for column in columns if column not in names]
    if missing or not lines:
        raise InputError(
            f"{file}: {'no column ' + ', '.join(missing) if missing else 'no line'}; the first line must be "
            f"{','.join(COLUMNS)} or {','.join(VECTOR_COLUMNS)}, every other one a view"
        )
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"{file}: the column {twice[0]!r} is there twice; which one is meant?")
    if turns := [name for name in names if name not in columns and SECOND_POSE.fullmatch(plain(name))]:
        raise InputError(
            f"{file}: the column {turns[0]!r} says what {', '.join(columns[4:])} say, or moves the pose; "
            "keep one way to say it"
        )
    refuse_bends(dict.fromkeys(names, 0.5), columns, str(file))
    warn_of_unknown([dict.fromkeys(names)], columns, file, logger)
    return [(_view(line, i, file, columns), f"{file}, line {i}") for i, line in enumerate(lines, start=2)]


def _view(line: dict[str, Any], number: int, file: Path, columns: tuple[str, ...]) -> dict[str, Any]:
    if None in line or None in line.values():
        raise InputError(f"{file}, line {number}: has more or fewer cells than the first line")
    place = [_number(line[column]) for column in columns[1:4]]
    turn = [_number(line[column]) for column in columns[4:]]
    kind = "quaternion_xyzw" if columns is COLUMNS else "rotation_vector"
    return {"image": line["image"].strip(), "base_from_flange": {"position": place, kind: turn}}


def _number(cell: str) -> float | str:
    """What a cell says, if it is a number."""
    try:
        return float(cell)
    except ValueError:
        return cell
