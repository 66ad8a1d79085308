"""A lens from an object that another program, or a person, wrote: intrinsics, size and distortion."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from neugrasp.data.bends import NO_PINHOLE, SHAPES
from neugrasp.data.camera_checks import check_intrinsics, numbers
from neugrasp.data.spelling import plain
from neugrasp.errors import InputError
from neugrasp.geometry.lens import Lens
from neugrasp.geometry.pose import Array
from neugrasp.importers.lens_keys import HIGHER, Entry, LensEntry, entry_of, is_other_lens, model_name

Size = tuple[float, float]
COEFFICIENTS = ("k1", "k2", "k3", "p1", "p2")
AGREEMENT = 0.01
"""Share of the focal length by which two ways to say it may differ; rounding makes a tenth of that."""
NARROWEST = np.radians(4)
"""Field of view in degrees; fewer would be radians, or no camera that sees a table."""
REMEDY = (
    "only pinholes with k1, k2, k3, p1 and p2 are undistorted here; undistort photos and backgrounds alike "
    "first, or calibrate again without it"
)


def lens_of(
    entry: Entry,
    where: str,
    has_corner_origin: bool = False,
    size_of: Callable[[], Size] | None = None,
    file: Entry | None = None,
) -> Lens:
    """The lens of a photo, or of all where there is but one object. `file` holds what counts where `entry`
    says nothing, `size_of` asks the photo for its size; principal points count from the corner of the first
    pixel with `has_corner_origin`, else from its centre. Raises `InputError` naming `where` and the key.
    """
    own, common = entry_of(entry, where), entry_of(file or {}, where)
    size = _size(own) or _size(common) or (size_of() if size_of is not None else None)
    if size is None:
        raise InputError(f"{where}: 'width' and 'height' of the photos are missing")
    fx, fy = _focal(own, size) or _focal(common, size) or _no_focal(where)
    shift = 0.5 if has_corner_origin else 0.0
    middle = (size[0] / 2 - 0.5 + shift, size[1] / 2 - 0.5 + shift)
    cx, cy = (
        next((value for part in (own, common) if (value := _centre(part, axis)) is not None), middle[axis])
        for axis in (0, 1)
    )
    k1, k2, p1, p2, k3 = _bends(own, common)
    _check_model(own if "model" in own else common, any((k1, k2, p1, p2, k3)))
    intrinsics = np.array([[fx, 0, cx - shift], [0, fy, cy - shift], [0, 0, 1.0]])
    if any(float(edge) % 1 for edge in size):
        raise InputError(f"{where}: photos of {size[0]:g} x {size[1]:g} pixels; both must be whole numbers")
    width, height = (int(edge) for edge in size)
    return checked(Lens(intrinsics, width, height, (k1, k2, k3), (p1, p2)), f"{where}: intrinsics")


def _size(entry: LensEntry) -> Size | None:
    if "width" in entry and "height" in entry:
        return entry.number("width"), entry.number("height")
    if "size" in entry:
        width, height = numbers(
            entry.said["size"][1], (2,), f"{entry.where}: {entry.said['size'][0]}"
        ).tolist()
        return width, height
    return None


def _matrix(entry: LensEntry) -> Array | None:
    if "matrix" not in entry:
        return None
    key, value = entry.said["matrix"]
    where = f"{entry.where}: {key}"
    values = _listed(value)
    if isinstance(values, list) and len(values) == 9:
        values = [values[row : row + 3] for row in (0, 3, 6)]
    matrix = numbers(values, (3, 3), where)
    if abs(matrix[0, 1]) > 0.01 * abs(matrix[0, 0]) or np.abs(matrix - np.triu(matrix)).max() > 1e-6:
        raise InputError(
            f"{where}: not a camera matrix without skew; it must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
        )
    if abs(matrix[2, 2] - 1) > 1e-6:
        raise InputError(f"{where}: its last row is not [0, 0, 1]")
    return matrix


def _listed(value: Any) -> Any:
    """An array written as an object, as OpenCV and ROS do, as a list."""
    is_array = isinstance(value, Mapping) and {plain(key) for key in value} <= {*SHAPES, "data", "typeid"}
    return value.get("data") if is_array else value


def _focal(entry: LensEntry, size: Size) -> tuple[float, float] | None:
    """fx and fy from whatever says them, which must agree where several do."""
    found: dict[str, tuple[float, float]] = {}
    matrix = _matrix(entry)
    if matrix is not None:
        found[entry.said["matrix"][0]] = (float(matrix[0, 0]), float(matrix[1, 1]))
    if "focal" in entry:
        found[entry.said["focal"][0]] = (entry.number("focal"),) * 2
    pairs = (("fx", "fy", 0.0), ("angle_x", "angle_y", 1.0), ("fov_x", "fov_y", np.pi / 180))
    for one, other, radians in pairs:
        values = [
            None if meaning not in entry else _focal_length(entry, meaning, size[axis], radians)
            for axis, meaning in enumerate((one, other))
        ]
        x, y = values[0] or values[1], values[1] or values[0]
        if x is not None and y is not None:
            found[entry.said[one if one in entry else other][0]] = (x, y)
    for key, focal in found.items():
        first, values_of_first = next(iter(found.items()))
        if not np.allclose(focal, values_of_first, rtol=AGREEMENT):
            raise InputError(
                f"{entry.where}: {first!r} and {key!r} say different focal lengths, {values_of_first[0]:.6g} "
                f"and {focal[0]:.6g} pixels; keep the right one"
            )
    for key in ("matrix", "fx"):
        if key in entry and entry.said[key][0] in found:
            return found[entry.said[key][0]]
    return next(iter(found.values()), None)


def _focal_length(entry: LensEntry, meaning: str, size: float, radians: float) -> float:
    """Pixels; `radians` are those of one unit of an angle, 0 for a length."""
    value = entry.number(meaning)
    if radians == 0:
        if value <= 0:
            raise InputError(f"{entry.where}: {entry.said[meaning][0]!r} is {value:g}; it must be positive")
        return value
    angle = value * radians
    if not (0.01 if radians == 1 else NARROWEST) < angle < 3.1:
        unit = "degrees" if radians < 1 else "radians, between 0 and pi"
        raise InputError(f"{entry.where}: {entry.said[meaning][0]!r} is {value:g}; it must be in {unit}")
    return float(size / 2 / np.tan(angle / 2))


def _no_focal(where: str) -> tuple[float, float]:
    raise InputError(
        f"{where}: no focal length; give 'intrinsics' [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], 'fl_x' and "
        "'fl_y', or 'camera_angle_x'"
    )


def _centre(entry: LensEntry, axis: int) -> float | None:
    matrix, key = _matrix(entry), ("cx", "cy")[axis]
    value = entry.number(key) if key in entry else None
    if "centre" in entry:
        name, listed = entry.said["centre"]
        point = float(numbers(_listed(listed), (2,), f"{entry.where}: {name}")[axis])
        if value is not None and abs(point - value) > 1:
            raise InputError(
                f"{entry.where}: {name!r} and {entry.said[key][0]!r} say different points; keep one"
            )
        value, key = point, "centre"
    if matrix is None:
        return value
    if value is not None and abs(matrix[axis, 2] - value) > 1:
        raise InputError(
            f"{entry.where}: {entry.said[key][0]!r} and {entry.said['matrix'][0]!r} say different principal "
            "points; keep the right one"
        )
    return float(matrix[axis, 2])


def _check_model(entry: LensEntry, is_bent: bool) -> None:
    """Raises `InputError` for a lens that is no pinhole, or whose coefficients mean something else."""
    if "model" not in entry:
        return
    key, value = entry.said["model"]
    word = model_name(value) if isinstance(value, str) else ""
    if re.fullmatch("(inverse|modified)brownconrady", word) and not is_bent:
        return
    is_product = plain(key) in ("model", "cameratype") and isinstance(value, str)
    if re.search(NO_PINHOLE + "|inverse|modified", word) if is_product else is_other_lens(value):
        what = key if value is True else f"{key} {value!r}"
        raise InputError(f"{entry.where}: {what} cannot be undistorted here; {REMEDY}")


def _bends(own: LensEntry, common: LensEntry) -> list[float]:
    """k1, k2, p1, p2, k3: a list of the photo's own, its own coefficients over the file's, or the file's."""
    if any(key in own for key in ("bends", "nerfstudio bends")):
        return _listed_bends(own)
    is_single = any(HIGHER.fullmatch(key) for key in own.said)
    if not is_single and any(key in common for key in ("bends", "nerfstudio bends")):
        return _listed_bends(common)
    both = {**common.said, **own.said}
    merged = LensEntry({key: said for key, said in both.items() if HIGHER.fullmatch(key)}, own.where)
    return _single_bends(merged)


def _single_bends(entry: LensEntry) -> list[float]:
    for key in entry.said:
        if HIGHER.fullmatch(key) and key not in COEFFICIENTS and entry.number(key) != 0:
            raise InputError(f"{entry.where}: {entry.said[key][0]} cannot be undistorted here; {REMEDY}")
    return [entry.number(key) if key in entry else 0.0 for key in ("k1", "k2", "p1", "p2", "k3")]


def _listed_bends(entry: LensEntry) -> list[float]:
    """Coefficients of a list in OpenCV's order k1, k2, p1, p2, k3, then zeros; or in nerfstudio's, k1 to
    k4, p1, p2."""
    is_nerfstudio = "nerfstudio bends" in entry
    if is_nerfstudio and "bends" in entry:
        raise InputError(f"{entry.where}: distortion_params and {entry.said['bends'][0]!r}; keep one")
    key, value = entry.said["nerfstudio bends" if is_nerfstudio else "bends"]
    where = f"{entry.where}: {key}"
    values = np.array(_listed(value), dtype=object).ravel().tolist() if value not in ("none", "") else []
    found = numbers(values, (len(values),), where).tolist()
    if is_nerfstudio and len(found) not in (0, 6):
        raise InputError(
            f"{where}: {len(found)} numbers; nerfstudio's are [k1, k2, k3, k4, p1, p2]. Write OpenCV's "
            "[k1, k2, p1, p2, k3] as 'distortion'"
        )
    if is_nerfstudio and found:
        k1, k2, k3, k4, p1, p2 = found
        found = [k1, k2, p1, p2, k3, k4]
    if len(found) not in (0, 1, 2, 4, 5, 6, 8, 12, 14) or any(found[5:]):
        raise InputError(
            f"{where}: must be [k1, k2, p1, p2, k3] as OpenCV gives it, what follows all 0 ({len(found)} "
            f"numbers are given); {REMEDY}"
        )
    single = _single_bends(entry)
    listed = [*found, *[0.0] * 5][:5]
    if any(single) and not np.allclose(single, listed):
        raise InputError(f"{where}: says another distortion than k1, k2, ... beside it; keep one")
    return listed


def lens_from_corner(
    focal: tuple[float, float],
    centre: tuple[float, float],
    size: tuple[int, int],
    where: str,
    radial: tuple[float, float, float] = (0.0, 0.0, 0.0),
    tangential: tuple[float, float] = (0.0, 0.0),
) -> Lens:
    """A lens whose principal point counts from the upper left corner of the photo, as in COLMAP and
    nerfstudio: the centre of the first pixel is (0.5, 0.5) there and (0, 0) here. Raises `InputError` naming
    `where`."""
    cx, cy = centre[0] - 0.5, centre[1] - 0.5
    intrinsics = np.array([[focal[0], 0, cx], [0, focal[1], cy], [0, 0, 1.0]])
    return checked(Lens(intrinsics, *size, radial, tangential), where)


def checked(lens: Lens, where: str) -> Lens:
    """The lens, if its numbers can be those of a camera. Raises `InputError` naming `where`."""
    if min(lens.width, lens.height) < 1:
        raise InputError(f"{where}: {lens.width} x {lens.height} is no size of a photo")
    check_intrinsics(lens.intrinsics, lens.width, lens.height, where)
    if not np.all(np.isfinite(lens.coefficients)):
        raise InputError(f"{where}: the distortion contains NaN or infinity")
    return lens
