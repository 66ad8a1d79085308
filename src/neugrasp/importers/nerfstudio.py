"""`transforms.json` of nerfstudio and instant-ngp: OpenGL cameras, pixels counted from the corner."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.camera_checks import OPENCV_FROM_OPENGL, check_rigid
from neugrasp.errors import InputError
from neugrasp.importers.files import read_object
from neugrasp.importers.lens import Lens, lens_from_corner
from neugrasp.importers.shots import Shot

PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
BEYOND = ("k4", "k5", "k6")
"""Coefficients whose meaning differs between programs."""

SizeOf = Callable[[str], tuple[int, int]]
"""Width and height of the photo of a name, for files that do not say."""


def read_transforms(file: Path, size_of: SizeOf) -> list[Shot]:
    """All frames. Raises `InputError` naming the file and the frame."""
    data = read_object(file)
    frames = data.get("frames")
    if not isinstance(frames, list) or not frames:
        raise InputError(f"{file}: 'frames' must be a list of at least one frame")
    return [_shot(data, frame, f"{file}, frame {i}", size_of) for i, frame in enumerate(frames)]


def _shot(data: dict[str, Any], frame: Any, where: str, size_of: SizeOf) -> Shot:
    if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
        raise InputError(f"{where}: must be an object with 'file_path' and 'transform_matrix'")
    matrix = frame.get("transform_matrix")
    if isinstance(matrix, list) and len(matrix) == 3:
        matrix = [*matrix, [0.0, 0.0, 0.0, 1.0]]
    world_from_gl = check_rigid(matrix, f"{where}: transform_matrix")
    name = frame["file_path"].removeprefix("./")
    lens = _lens({**data, **frame}, where, name, size_of)
    # The matrix that turns the axes is its own inverse.
    return Shot(name, lens, world_from_gl @ OPENCV_FROM_OPENGL)


def _lens(entry: dict[str, Any], where: str, name: str, size_of: SizeOf) -> Lens:
    """The entries of the frame win over those of the file."""
    model = entry.get("camera_model", "OPENCV")
    unknown = [key for key in BEYOND if entry.get(key)]
    if entry.get("is_fisheye") or model not in PINHOLES:
        unknown = ["is_fisheye" if entry.get("is_fisheye") else f"camera_model {model!r}"]
    if unknown:
        raise InputError(
            f"{where}: {unknown[0]} cannot be undistorted here, only pinholes with k1, k2, k3, p1 and p2; "
            "undistort the photos first, e.g. with `colmap image_undistorter`"
        )

    def number(key: str, otherwise: float | None = None) -> float:
        value = entry.get(key, otherwise)
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise InputError(f"{where}: {key!r} is {value!r}; it must be a number")
        return float(value)

    width, height = (number("w"), number("h")) if "w" in entry and "h" in entry else size_of(name)
    if "fl_x" in entry:
        fx = number("fl_x")
        fy = number("fl_y", fx)
    else:
        fx = width / 2 / np.tan(number("camera_angle_x") / 2)
        fy = height / 2 / np.tan(number("camera_angle_y") / 2) if "camera_angle_y" in entry else fx
    return lens_from_corner(
        (float(fx), float(fy)),
        (number("cx", width / 2), number("cy", height / 2)),
        (round(width), round(height)),
        where,
        (number("k1", 0.0), number("k2", 0.0), number("k3", 0.0)),
        (number("p1", 0.0), number("p2", 0.0)),
    )
