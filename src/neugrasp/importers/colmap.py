"""Sparse models of COLMAP, as text and as binary: camera_from_world, wxyz."""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from neugrasp.data.user_files import check_name, read_bytes, read_text
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, from_quaternion, inverse
from neugrasp.importers.colmap_cameras import MODELS, ColmapCamera, model_of
from neugrasp.importers.posed_image import Listed, PosedImage

Cameras = dict[int, ColmapCamera]
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
POSE_FIELDS = 10
"""Fields of the first line of an image: number, quaternion, translation, camera, name."""

logger = logging.getLogger(__name__)


def read_model(folder: Path) -> list[Listed]:
    """All registered images of the model in `folder`, binary where it has both. Raises `InputError`.

    Of newer models with rigs, cameras and images say all that is needed: every image has its own pose.
    """
    for suffix, read_cameras, read_images in (
        ("bin", _binary_cameras, _binary_images),
        ("txt", _text_cameras, _text_images),
    ):
        cameras_file, images_file = folder / f"cameras.{suffix}", folder / f"images.{suffix}"
        if cameras_file.exists() and images_file.exists():
            try:
                cameras = _by_number(cameras_file, read_cameras(cameras_file))
                listed = list(read_images(images_file, cameras))
            except InputError:
                raise
            except (ValueError, KeyError, IndexError, OverflowError, MemoryError, struct.error) as error:
                raise InputError(f"{folder}: damaged COLMAP model ({error!r})") from error
            if not listed:
                raise InputError(f"{images_file}: no image is registered in this model")
            if suffix == "bin" and (other := images_file.with_suffix(".txt")).exists():
                logger.warning("%s is read, %s beside it is not", images_file, other.name)
            return listed
    models = sorted(str(file.parent) for file in folder.rglob("cameras.*") if file.suffix in (".bin", ".txt"))
    hint = f"; did you mean {models[0]}?" if models else ""
    raise InputError(
        f"{folder}: no COLMAP model; it needs cameras.bin and images.bin, or the same as .txt{hint}"
    )


def _by_number(file: Path, cameras: Iterable[ColmapCamera]) -> Cameras:
    found: Cameras = {}
    for camera in cameras:
        if found.setdefault(camera.number, camera) is not camera:
            raise InputError(f"{file}: two cameras have the number {camera.number}; is the file damaged?")
    return found


def _listed(file: Path, name: str, pose: Sequence[float], camera: int, cameras: Cameras) -> Listed:
    """An image with qw, qx, qy, qz, tx, ty, tz as they are written."""
    check_name(name, str(file))
    if not name.strip():
        raise InputError(f"{file}: an image without a name; is the file damaged?")
    if camera not in cameras:
        raise InputError(f"{file}: {name} has camera {camera}, which is not in the cameras' file")
    return Listed(name, lambda: _shot(file, name, pose, cameras[camera]))


def _shot(file: Path, name: str, pose: Sequence[float], camera: ColmapCamera) -> PosedImage:
    if not np.all(np.isfinite(pose)) or np.abs(pose).max() > 1e9:
        raise InputError(f"{file}: {name}: the pose is not finite; is the file damaged?")
    norm = float(np.linalg.norm(pose[:4]))
    if not 0.99 < norm < 1.01:
        raise InputError(
            f"{file}: {name}: no pose (quaternion of length {norm:.3g}, it must be 1); is the file damaged?"
        )
    w, x, y, z = pose[:4]
    written = from_quaternion([x, y, z, w], np.array(pose[4:]))
    reordered = from_quaternion([w, x, y, z], np.array(pose[4:]))
    return PosedImage(
        name, camera.lens(), inverse(written), suspects=_suspects(file.name, written, reordered)
    )


def _suspects(file: str, written: Array, reordered: Array) -> dict[str, Array]:
    right = "COLMAP's poses are world-to-camera (OpenCV axes, quaternion w, x, y, z)"
    return {
        f"{file} holds camera-to-world poses; {right}: write the inverse": written,
        f"{file} holds camera-to-world poses with OpenGL axes; {right}: multiply by diag(1, -1, -1, 1) from "
        "the right and write the inverse": written @ OPENGL,
        f"{file} has poses with OpenGL axes; {right}: multiply by diag(1, -1, -1, 1) from the left": inverse(
            written
        )
        @ OPENGL,
        f"{file} has quaternions in the order x, y, z, w; {right}": inverse(reordered),
        f"{file} holds camera-to-world poses with quaternions in the order x, y, z, w; {right}": reordered,
    }


def _lines(file: Path) -> list[str]:
    lines = read_text(file).replace("\r\n", "\n").split("\n")
    return [line for line in lines if not line.startswith("#")]


def _text_cameras(file: Path) -> Iterator[ColmapCamera]:
    for line in filter(str.strip, _lines(file)):
        number, model, width, height, *values = line.split()
        yield ColmapCamera(
            file, int(number), model, int(width), int(height), tuple(float(value) for value in values)
        )


def _text_images(file: Path, cameras: Cameras) -> Iterator[Listed]:
    """Two lines for every image: its pose, then its points. Scripts that write models often leave the second
    line out where there are no points, although it must be there and empty; both are understood."""
    lines = _lines(file)
    missing = 0
    place = 0
    while place < len(lines):
        line = lines[place]
        place += 1
        if not line.strip():
            continue
        if not _is_pose(line):
            raise InputError(_no_line_of_an_image(file, line))
        # The name comes last and may hold blanks.
        _, *pose, camera, name = line.split(maxsplit=POSE_FIELDS - 1)
        yield _listed(file, name.strip(), [float(value) for value in pose], int(camera), cameras)
        if place < len(lines) and _is_pose(lines[place]):
            missing += 1
        elif place < len(lines) and not _is_points(lines[place]):
            raise InputError(_no_line_of_an_image(file, lines[place]))
        else:
            place += 1
    if missing:
        logger.warning(
            "%s: after %d images the line of the points is missing; it must be there, empty without points",
            file,
            missing,
        )


def _no_line_of_an_image(file: Path, line: str) -> str:
    return (
        f"{file}: {line[:60]!r} is neither the pose of an image (number, quaternion, translation, camera, "
        "name) nor the points of one (x, y, number of the point, ...); is the file damaged?"
    )


def _is_pose(line: str) -> bool:
    """Whether a line is an image's first one."""
    words = line.split()
    if len(words) < POSE_FIELDS or _is_points(line):
        return False
    return words[0].isdecimal() and words[8].isdecimal() and all(map(_is_number, words[1:8]))


def _is_points(line: str) -> bool:
    """Whether a line is an image's second one: threes of two numbers and a whole one, or nothing."""
    words = line.split()
    return (
        len(words) % 3 == 0
        and all(map(_is_number, words))
        and all(word.removeprefix("-").isdecimal() for word in words[2::3])
    )


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


class _Bytes:
    """Little-endian numbers one after the other."""

    def __init__(self, file: Path):
        self.data, self.place = read_bytes(file), 0

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


def _binary_cameras(file: Path) -> Iterator[ColmapCamera]:
    data = _Bytes(file)
    (count,) = data.take("Q")
    for _ in range(int(count)):
        number, kind, width, height = (int(value) for value in data.take("iiQQ"))
        model = model_of(kind, file)
        yield ColmapCamera(file, number, model, width, height, data.take("d" * MODELS[model]))


def _binary_images(file: Path, cameras: Cameras) -> Iterator[Listed]:
    data = _Bytes(file)
    (count,) = data.take("Q")
    for _ in range(int(count)):
        _, *pose, camera = data.take("i7di")
        name = data.word()
        (points,) = data.take("Q")
        data.skip(24 * int(points))
        yield _listed(file, name, pose, int(camera), cameras)
