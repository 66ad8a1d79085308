"""A camera's intrinsics and distortion under the names that programs give them.

OpenCV and ROS (`camera_matrix`, `K`, `D`, `distortion_coefficients`), RealSense (`ppx`, `coeffs`), Orbbec
(`intrinsic` with `distortion`), nerfstudio and instant-ngp (`fl_x`, `camera_angle_x`, `distortion_params`).
Where a photo has values of its own, they win over those of the whole file, whatever either calls them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from neugrasp.data.bends import PINHOLE_MODELS
from neugrasp.data.camera_checks import numbers
from neugrasp.data.known_keys import is_remark, refuse_bends
from neugrasp.data.spelling import plain
from neugrasp.errors import InputError

Entry = Mapping[str, Any]
NAMES: dict[str, tuple[str, ...]] = {
    "matrix": (
        *("intrinsics", "intrinsic_matrix", "intrinsics_matrix", "intrinsic", "camera_intrinsics", "cam_K"),
        *("camera_matrix", "K", "matrix", "camera_intrinsic"),
    ),
    "width": ("w", "width", "image_width", "img_width"),
    "height": ("h", "height", "image_height", "img_height"),
    "size": ("image_size", "img_size", "resolution", "image_resolution"),
    "fx": ("fl_x", "fx", "focal_x", "focal_length_x"),
    "fy": ("fl_y", "fy", "focal_y", "focal_length_y"),
    "focal": ("focal", "f", "focal_length", "fl"),
    "angle_x": ("camera_angle_x",),
    "angle_y": ("camera_angle_y",),
    "fov_x": ("x_fov", "fov_x"),
    "fov_y": ("y_fov", "fov_y"),
    "cx": ("cx", "c_x", "ppx", "principal_point_x", "principal_x", "center_x", "centre_x", "u0"),
    "cy": ("cy", "c_y", "ppy", "principal_point_y", "principal_y", "center_y", "centre_y", "v0"),
    "centre": ("principal_point", "principal", "pp", "optical_center", "optical_centre"),
    "bends": (
        *("distortion", "distortion_coefficients", "distortion_coeffs", "distortion_coefs", "dist_coeffs"),
        *("dist_coefs", "dist", "D", "dist_coefficients", "coeffs", "kc", "distortion_parameters"),
        *("distCoeffs", "distortionCoefficients", "lens_distortion", "distortion_vector"),
    ),
    "nerfstudio bends": ("distortion_params",),
    "k1": ("k1",),
    "k2": ("k2",),
    "k3": ("k3",),
    "p1": ("p1",),
    "p2": ("p2",),
    "model": (
        *("camera_model", "distortion_model", "lens_model", "projection_model", "projection", "model"),
        *("camera_type", "projection_type", "distortion_type", "lens_type", "is_fisheye", "fisheye"),
    ),
}
"""What a key means, with its spellings; capitals, blanks and underscores make no difference."""
MEANINGS = {plain(name): meaning for meaning, names in NAMES.items() for name in names}
LENS_KEYS = tuple(name for names in NAMES.values() for name in names)
HIGHER = re.compile(r"k\d+|p\d+|s[1-4]|tau[xy]")
"""Coefficients; those without a meaning of their own must be zero."""
POINT = re.compile(r"[xy]0|[po][xy]|c[uv]|c|cent(er|re)")
"""Plain keys that others give to a principal point, or to something else."""
SAYINGS = (
    "fps",
    "framerate",
    "serial",
    "serialnumber",
    "reprojectionerror",
    "rms",
    "error",
    "isvalid",
    "valid",
)
"""Plain keys of a lens's object that bend nothing."""


@dataclass(frozen=True)
class LensEntry:
    """What one object says of a lens: meanings with the key and the value."""

    said: Mapping[str, tuple[str, Any]]
    where: str

    def __contains__(self, meaning: str) -> bool:
        return meaning in self.said

    def number(self, meaning: str) -> float:
        """The number of a meaning. Raises `InputError` naming the key."""
        key, value = self.said[meaning]
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{self.where}: {key!r} is {value!r}; it must be a number")
        return float(numbers(value, (), f"{self.where}: {key}"))


def entry_of(entry: Entry, where: str) -> LensEntry:
    """What an object says of a lens; objects within it, such as RealSense's and Orbbec's, are opened.

    Raises `InputError` where one thing is said twice, differently.
    """
    said: dict[str, tuple[str, Any]] = {}
    for key, value in _flat(entry):
        word = plain(key)
        meaning = MEANINGS.get(word) or (word if HIGHER.fullmatch(word) else None)
        if meaning is None or value is None:
            continue
        if meaning in said and said[meaning][1] != value and meaning != "model":
            raise InputError(f"{where}: {said[meaning][0]!r} and {key!r} say the same differently; keep one")
        if meaning != "model" or meaning not in said or is_other_lens(value):
            said[meaning] = (key, value)
    return LensEntry(said, where)


def check_lens_keys(entry: Entry, known: Iterable[str], where: str) -> None:
    """Raises `InputError` for a key beyond `known` that bends geometry and is not understood as a lens."""
    flat = dict(_flat(entry))
    refuse_bends(flat, {*known, *filter(is_lens_key, flat)}, where)
    for key, value in flat.items():
        if POINT.fullmatch(plain(key)) and not is_lens_key(key) and _is_point(value):
            raise InputError(
                f"{where}: {key!r} may be a principal point; write 'cx' and 'cy', or leave it away"
            )
        if key in entry or is_lens_key(key) or is_remark(key) or plain(key) in SAYINGS:
            continue
        if not isinstance(value, str | None) and value != 0:
            raise InputError(
                f"{where}: {key!r} within a lens is not understood; give it as docs/data_format.md names it, "
                "or leave it away"
            )


def _is_point(value: Any) -> bool:
    """Whether a value is a number, or two."""
    parts = value if isinstance(value, list) and len(value) == 2 else [value]
    return all(isinstance(part, int | float) for part in parts)


def is_lens_key(key: str) -> bool:
    """Whether `lens_of` reads the key."""
    return plain(key) in MEANINGS or HIGHER.fullmatch(plain(key)) is not None


def _flat(entry: Entry, depth: int = 0) -> list[tuple[str, Any]]:
    """The keys of an object and of those in it that describe a lens, but not of arrays written as objects."""
    pairs = []
    for key, value in entry.items():
        is_lens = MEANINGS.get(plain(key)) in ("matrix", "bends", "size")
        if is_lens and isinstance(value, Mapping) and "data" not in value and depth < 2:
            pairs += _flat(value, depth + 1)
        else:
            pairs.append((key, value))
    return pairs


def is_other_lens(value: Any) -> bool:
    if isinstance(value, str):
        return model_name(value) not in PINHOLE_MODELS
    return bool(value)


def model_name(name: str) -> str:
    """The name of a model in letters alone, without RealSense's prefix."""
    return re.sub(r"^(rs2)?distortion", "", plain(name))
