"""`transforms.json` of nerfstudio and instant-ngp: OpenGL cameras, pixels counted from the corner."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.camera_checks import OPENCV_FROM_OPENGL, check_rigid, numbers
from neugrasp.data.known_keys import warn_of_unknown
from neugrasp.data.spelling import plain
from neugrasp.data.strict_json import read_object
from neugrasp.data.user_files import check_name
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, inverse, rigid
from neugrasp.importers.foreign_lens import lens_of
from neugrasp.importers.lens_keys import LENS_KEYS, check_lens_keys, is_lens_key
from neugrasp.importers.posed_image import Listed, PosedImage

FILE_KEYS = (
    *("frames", "applied_scale", "applied_transform", "orientation_override", "aabb_scale", "aabb", "scale"),
    *("offset", "n_frames", "ply_file_path", "fix_premult", "white_transparent", "black_transparent", "up"),
    *("enable_depth_loading", "integer_depth_scale", "depth_unit_scale_factor", "sharpness", "render_aabb"),
    *(
        "train_filenames",
        "val_filenames",
        "test_filenames",
        "applied_transform_type",
        "auto_scale_poses_factor",
    ),
)
"""Poses are taken as they stand in the file; what nerfstudio and instant-ngp do with them later is theirs."""
FRAME_KEYS = (
    *(
        "file_path",
        "transform_matrix",
        "sharpness",
        "colmap_im_id",
        "mask_path",
        "depth_file_path",
        "depth_path",
    ),
    *("timestamp", "time", "camera_id", "rotation", "normal_file_path", "semantic_path", "id", "image_id"),
)
OPENGL = {"opengl", "blender", "nerf", "nerfstudio", "instantngp", "ngp"}

Z_UP_FROM_Y_UP = rigid([[1, 0, 0], [0, 0, -1], [0, 1, 0]])

SizeOf = Callable[[str], tuple[int, int]]
"""Width and height of the photo of a name, for files that do not say."""

logger = logging.getLogger(__name__)


def read_transforms(file: Path, size_of: SizeOf) -> list[Listed]:
    """All frames. Raises `InputError` naming the file and the frame."""
    data = read_object(file, "a list of frames")
    frames = data.get("frames")
    if not isinstance(frames, list) or not frames:
        raise InputError(f"{file}: 'frames' must be a list of at least one frame")
    common = _without_convention(data, str(file))
    objects = [frame for frame in frames if isinstance(frame, dict)]
    keys = {key for entry in (data, *objects) for key in entry if is_lens_key(key)}
    warn_of_unknown([common], {*FILE_KEYS, *LENS_KEYS, *keys}, file, logger)
    warn_of_unknown(objects, {*FRAME_KEYS, *LENS_KEYS, *keys}, f"{file}, frames", logger)
    return [_listed(common, frame, f"{file}, frame {i}", size_of) for i, frame in enumerate(frames)]


def check_motion(file: Path, has_scale: bool, has_place: bool) -> None:
    """Whether what the file says of its poses is made up for: `has_scale` and `has_place` say that the user
    told the scale, or the place, of the poses as they stand. Raises `InputError`."""
    data = read_object(file, "a list of frames")
    scale = float(numbers(data.get("applied_scale", 1.0), (), f"{file}: applied_scale"))
    if scale <= 0:
        raise InputError(f"{file}: applied_scale is {scale:g}; it must be positive")
    if abs(scale - 1) > 1e-6 and not has_scale:
        raise InputError(
            f"{file}: applied_scale {scale:g}: its poses were multiplied by that and are not metric as they "
            f"stand. Write metres_per_unit into the alignment ({1 / scale:.6g} if they were metric before), "
            "or use --board"
        )
    moved = data.get("applied_transform")
    if moved is None or has_place:
        return
    rows = moved[:3] if isinstance(moved, list) else moved
    if not np.allclose(numbers(rows, (3, 4), f"{file}: applied_transform"), np.eye(4)[:3], atol=1e-6):
        raise InputError(
            f"{file}: applied_transform: its poses were moved by that matrix. Write "
            "world_from_reconstruction into the alignment (the inverse of applied_transform if your world "
            "is that before, the identity if it is that of the file), or use --board"
        )


def _without_convention(entry: dict[str, Any], where: str) -> dict[str, Any]:
    """The entry without keys that say that its cameras are OpenGL's, as they are. Raises `InputError` for one
    that says otherwise."""
    said = {
        key: value for key, value in entry.items() if re.search("convention|coordinatesystem", plain(key))
    }
    for key, value in said.items():
        if not isinstance(value, str) or plain(value) not in OPENGL:
            raise InputError(
                f"{where}: {key} is {value!r}, but cameras of transforms.json have OpenGL axes (x right, y "
                "up, looking along -z); convert the poses and leave it away"
            )
    return {key: value for key, value in entry.items() if key not in said}


def _listed(data: dict[str, Any], frame: Any, where: str, size_of: SizeOf) -> Listed:
    if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str) or not frame["file_path"]:
        raise InputError(f"{where}: must be an object with 'file_path' and 'transform_matrix'")
    name = frame["file_path"].removeprefix("./")
    check_name(name, where)
    return Listed(name, lambda: _shot(data, frame, where, name, size_of))


def _shot(data: dict[str, Any], frame: dict[str, Any], where: str, name: str, size_of: SizeOf) -> PosedImage:
    check_lens_keys(data, FILE_KEYS, where)
    check_lens_keys(_without_convention(frame, where), FRAME_KEYS, where)
    matrix = frame.get("transform_matrix")
    if isinstance(matrix, list) and len(matrix) == 3:
        matrix = [*matrix, [0.0, 0.0, 0.0, 1.0]]
    written = check_rigid(matrix, f"{where}: transform_matrix")
    lens = lens_of(frame, where, has_corner_origin=True, size_of=lambda: size_of(name), file=data)
    # The matrix that turns the axes is its own inverse.
    pose, suspects = written @ OPENCV_FROM_OPENGL, _suspects(written)
    return PosedImage(name, lens, pose, suspects=suspects, rare_suspects=_rare_suspects(written))


def _suspects(written: Array) -> dict[str, Array]:
    what = "transform_matrix holds"
    right = "transforms.json wants camera-to-world with OpenGL axes (x right, y up, looking along -z)"
    turn = "diag(1, -1, -1, 1)"
    axes = "OpenCV axes (x right, y down, z forward)"
    return {
        f"{what} {axes}; {right}: multiply by {turn} from the right": written,
        f"{what} world-to-camera; {right}: write the inverse": inverse(written) @ OPENCV_FROM_OPENGL,
        f"{what} world-to-camera with OpenCV axes; {right}: write the inverse times {turn}": inverse(written),
    }


def _rare_suspects(written: Array) -> dict[str, Array]:
    """Poses of worlds whose vertical is another axis than that of the alignment's."""
    pose, where = written @ OPENCV_FROM_OPENGL, "write world_from_reconstruction"
    return {
        f"its world has y up (as of ARKit, ARCore, Unity), the alignment's z: {where} [[1, 0, 0, 0], "
        "[0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]] into the alignment": Z_UP_FROM_Y_UP @ pose,
        f"its world has z up, the alignment's y: {where} [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], "
        "[0, 0, 0, 1]] into the alignment": Z_UP_FROM_Y_UP.T @ pose,
    }
