"""Photos from a camera on a robot's flange: poses of the flange, hand-eye calibration, one lens.

The file `robot.json`:

    {"intrinsics": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "width": 640, "height": 480,
     "distortion": [k1, k2, p1, p2, k3],
     "flange_from_camera": POSE,
     "views": [{"image": "0.png", "base_from_flange": POSE}, ...]}

A POSE is a 4 x 4 matrix or {"position": [x, y, z], "quaternion_xyzw": [x, y, z, w]}, metres. `views` may
instead name a CSV file beside it with the columns image, x, y, z, qx, qy, qz, qw. A view may also have
`background_base_from_flange`, where its background was taken from a slightly different pose. The camera's
axes are OpenCV's, pixel centres lie at integers (as OpenCV calibrates), and the world is the robot's base.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from neugrasp.data.camera_checks import numbers
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array
from neugrasp.importers.files import pose_of, read_object
from neugrasp.importers.lens import Lens, checked
from neugrasp.importers.shots import Shot

COLUMNS = ("image", "x", "y", "z", "qx", "qy", "qz", "qw")


def read_robot(file: Path) -> list[Shot]:
    """world_from_camera = base_from_flange @ flange_from_camera for every view. Raises `InputError`."""
    data = read_object(file)
    lens = lens_of(data, file)
    flange_from_camera = pose_of(data.get("flange_from_camera"), f"{file}: flange_from_camera")
    views = data.get("views")
    if isinstance(views, str):
        return [_shot(lens, flange_from_camera, *row) for row in _rows(file.parent / views)]
    if not isinstance(views, list) or not views:
        raise InputError(f"{file}: 'views' must be a list of at least one view, or the name of a CSV file")
    return [_shot(lens, flange_from_camera, entry, f"{file}, view {i}") for i, entry in enumerate(views)]


def _shot(lens: Lens, flange_from_camera: Array, entry: Any, where: str) -> Shot:
    """The view, and its background where that has a pose of its own."""
    if not isinstance(entry, dict) or not isinstance(entry.get("image"), str) or not entry["image"]:
        raise InputError(f"{where}: must be an object with 'image' and 'base_from_flange'")
    base_from_flange = pose_of(entry.get("base_from_flange"), f"{where}: base_from_flange")
    world_from_background = None
    if entry.get("background_base_from_flange") is not None:
        pose = pose_of(entry["background_base_from_flange"], f"{where}: background_base_from_flange")
        world_from_background = pose @ flange_from_camera
    return Shot(entry["image"], lens, base_from_flange @ flange_from_camera, world_from_background)


def _rows(file: Path) -> list[tuple[dict[str, Any], str]]:
    """The lines of a CSV file as views, each with where it stands."""
    try:
        with file.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream, skipinitialspace=True)
            missing = [column for column in COLUMNS if column not in (reader.fieldnames or ())]
            lines = [] if missing else list(reader)
    except FileNotFoundError:
        raise InputError(f"{file}: missing; 'views' names it") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{file}: no CSV file ({error})") from error
    if missing or not lines:
        raise InputError(
            f"{file}: {'no column ' + ', '.join(missing) if missing else 'no line'}; the first line must be "
            f"{','.join(COLUMNS)}, every other one a view"
        )
    rows = []
    for i, line in enumerate(lines):
        pose = {
            "position": [line[column] for column in COLUMNS[1:4]],
            "quaternion_xyzw": [line[column] for column in COLUMNS[4:]],
        }
        rows.append(({"image": line["image"], "base_from_flange": pose}, f"{file}, line {i + 2}"))
    return rows


def lens_of(data: dict[str, Any], file: Path) -> Lens:
    """The lens of an object with `intrinsics`, `width`, `height` and perhaps `distortion`, as in OpenCV."""
    width, height = (
        round(float(numbers(data.get(key), (), f"{file}: {key}"))) for key in ("width", "height")
    )
    values = data.get("distortion", [])
    if not isinstance(values, list) or len(values) > 5:
        raise InputError(
            f"{file}: distortion must be [k1, k2, p1, p2, k3] as OpenCV gives it; undistort photos of other "
            "models first"
        )
    k1, k2, p1, p2, k3 = numbers([*values, *[0.0] * (5 - len(values))], (5,), f"{file}: distortion").tolist()
    intrinsics = numbers(data.get("intrinsics"), (3, 3), f"{file}: intrinsics")
    return checked(Lens(intrinsics, width, height, (k1, k2, k3), (p1, p2)), f"{file}: intrinsics")
