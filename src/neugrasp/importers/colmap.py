"""Sparse models of COLMAP, as text and as binary: camera_from_world, wxyz, pixels counted from the corner."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from neugrasp.errors import InputError
from neugrasp.geometry.pose import from_quaternion, inverse
from neugrasp.importers.lens import Lens, lens_from_corner
from neugrasp.importers.shots import Shot

MODELS = (
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "OPENCV_FISHEYE",
    "FULL_OPENCV",
    "FOV",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "THIN_PRISM_FISHEYE",
)
"""By their number in binary files."""
PINHOLES = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV")
PARAMETERS = dict(zip(MODELS, (3, 4, 4, 5, 8, 8, 12, 5, 4, 5, 12), strict=True))


def read_model(folder: Path) -> list[Shot]:
    """All registered images of the model in `folder`, binary where it has both. Raises `InputError`."""
    for suffix, read_cameras, read_images in (
        ("bin", _binary_cameras, _binary_images),
        ("txt", _text_cameras, _text_images),
    ):
        cameras_file, images_file = folder / f"cameras.{suffix}", folder / f"images.{suffix}"
        if cameras_file.is_file() and images_file.is_file():
            try:
                lenses = dict(read_cameras(cameras_file))
                shots = list(read_images(images_file, lenses))
            except InputError:
                raise
            except (ValueError, KeyError, IndexError, struct.error) as error:
                raise InputError(f"{folder}: damaged COLMAP model ({error!r})") from error
            if not shots:
                raise InputError(f"{images_file}: no image is registered in this model")
            return shots
    models = sorted(str(file.parent) for file in folder.rglob("cameras.*") if file.suffix in (".bin", ".txt"))
    hint = f"; did you mean {models[0]}?" if models else ""
    raise InputError(
        f"{folder}: no COLMAP model; it needs cameras.bin and images.bin, or the same as .txt{hint}"
    )


def _lens(model: str, size: tuple[int, int], values: Sequence[float], file: Path) -> Lens:
    """The lens of a camera with COLMAP's parameters."""
    if model not in PINHOLES or (model == "FULL_OPENCV" and any(values[9:])):
        raise InputError(
            f"{file}: camera model {model} cannot be undistorted here, only {', '.join(PINHOLES)} (the last "
            "without k4 to k6); undistort the photos first: `colmap image_undistorter`"
        )
    if PARAMETERS[model] != len(values):
        raise InputError(f"{file}: {model} has {PARAMETERS[model]} parameters, not {len(values)}")
    has_one_focal_length = model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
    focal = (values[0], values[0] if has_one_focal_length else values[1])
    cx, cy, *bends = values[1 if has_one_focal_length else 2 :]
    # k1 and k2, then, in the models of OpenCV, p1, p2 and k3.
    k1, k2, p1, p2, k3 = [*bends, *[0.0] * 5][:5]
    return lens_from_corner(focal, (cx, cy), size, f"{file}: {model}", (k1, k2, k3), (p1, p2))


def _shot(name: str, quaternion_wxyz: Sequence[float], translation: Sequence[float], lens: Lens) -> Shot:
    w, x, y, z = quaternion_wxyz
    norm = float(np.linalg.norm(quaternion_wxyz))
    if not 0.99 < norm < 1.01 or not np.all(np.isfinite(translation)):
        raise ValueError(f"{name}: no pose (quaternion of length {norm:.3g})")
    return Shot(name, lens, inverse(from_quaternion([x, y, z, w], np.array(translation))))


def _lines(file: Path) -> list[str]:
    lines = file.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if not line.startswith("#")]


def _text_cameras(file: Path) -> Iterator[tuple[int, Lens]]:
    for line in filter(str.strip, _lines(file)):
        number, model, width, height, *values = line.split()
        yield int(number), _lens(model, (int(width), int(height)), [float(v) for v in values], file)


def _text_images(file: Path, lenses: dict[int, Lens]) -> Iterator[Shot]:
    """Two lines for every image; the second, with the points, may be empty."""
    lines = _lines(file)
    while lines and not lines[0].strip():
        lines.pop(0)
    for line in lines[::2]:
        if line.strip():
            # The name comes last and may hold blanks.
            _, qw, qx, qy, qz, tx, ty, tz, camera, name = line.split(maxsplit=9)
            pose = [float(value) for value in (qw, qx, qy, qz, tx, ty, tz)]
            yield _shot(name.strip(), pose[:4], pose[4:], lenses[int(camera)])


class _Bytes:
    """Little-endian numbers one after the other."""

    def __init__(self, file: Path):
        self.data, self.place = file.read_bytes(), 0

    def take(self, kinds: str) -> tuple[float, ...]:
        values = struct.unpack_from("<" + kinds, self.data, self.place)
        self.place += struct.calcsize("<" + kinds)
        return values

    def skip(self, count: int) -> None:
        self.place += count
        if self.place > len(self.data):
            raise ValueError("the file ends too early")

    def word(self) -> str:
        """Up to the next zero byte."""
        end = self.data.index(b"\0", self.place)
        word = self.data[self.place : end].decode("utf-8")
        self.place = end + 1
        return word


def _binary_cameras(file: Path) -> Iterator[tuple[int, Lens]]:
    data = _Bytes(file)
    (count,) = data.take("Q")
    for _ in range(int(count)):
        number, kind, width, height = (int(value) for value in data.take("iiQQ"))
        if not 0 <= kind < len(MODELS):
            raise InputError(f"{file}: unknown camera model {kind}")
        values = data.take("d" * PARAMETERS[MODELS[kind]])
        yield number, _lens(MODELS[kind], (width, height), values, file)


def _binary_images(file: Path, lenses: dict[int, Lens]) -> Iterator[Shot]:
    data = _Bytes(file)
    (count,) = data.take("Q")
    for _ in range(int(count)):
        _, *pose, camera = data.take("i7di")
        name = data.word()
        (points,) = data.take("Q")
        data.skip(24 * int(points))
        yield _shot(name, pose[:4], pose[4:], lenses[int(camera)])
