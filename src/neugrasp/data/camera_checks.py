"""Whether numbers that a user wrote down can be cameras that see the workspace; if not, what is wrong."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any

import numpy as np

from neugrasp.errors import InputError
from neugrasp.geometry.camera import Box, Camera
from neugrasp.geometry.pose import Array, inverse, is_rigid, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import Observation

FARTHEST_CAMERA = 10.0
"""Metres between a camera and the workspace; beyond it the numbers are taken for millimetres."""
LARGEST_NUMBER = 1e9
"""Largest size of anything that is measured; squares of larger numbers lose the small ones beside them."""
SMALLEST_PART = 8
"""Pixels of a padded photo that were measured, across."""
UNITS = {"millimetres": 1000, "centimetres": 100, "inches": 39.37}
"""Units in one metre; those in which poses are written, too."""
USUAL_DISTANCES = 0.15, 3.0
"""Metres between a camera and what it shows."""
OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])

logger = logging.getLogger(__name__)


def numbers(value: Any, shape: tuple[int, ...], where: str) -> Array:
    """`value` as a float64 array of `shape`, all finite."""
    try:
        array = np.array(value, dtype=np.float64) if _is_numeric(value) else None
    except (TypeError, ValueError, OverflowError):
        array = None
    wanted = " x ".join(str(n) for n in shape) + " numbers" if shape else "a number"
    if array is None or value is None or array.shape != shape:
        given = "missing" if value is None else "of another shape or type"
        raise InputError(f"{where}: {given}; it must be {wanted}")
    if not np.all(np.isfinite(array)):
        raise InputError(f"{where}: contains NaN or infinity; it must be {wanted}, all finite")
    if np.any(np.abs(array) > LARGEST_NUMBER):
        raise InputError(f"{where}: {np.abs(array).max():.3g} is no length and no pixel; it must be {wanted}")
    return array


def _is_numeric(value: Any) -> bool:
    """Whether there are numbers alone in lists, or an array; words and truth values are none."""
    if isinstance(value, list | tuple):
        return all(map(_is_numeric, value))
    return isinstance(value, int | float | np.ndarray | np.number) and not isinstance(value, bool)


def check_rigid(value: Any, where: str) -> Array:
    """`value` as a 4x4 rigid transform."""
    pose = numbers(value, (4, 4), where)
    if is_rigid(pose):
        return pose
    rotation = pose[:3, :3]
    squared = rotation @ rotation.T
    scale = np.sqrt(np.trace(squared) / 3)
    if not np.allclose(pose[3], (0, 0, 0, 1), atol=1e-3):
        reason = f"its last row is {pose[3].tolist()}, not [0, 0, 0, 1] (column-major, or written by rows?)"
    elif scale > 1e-6 and np.allclose(squared / scale**2, np.eye(3), atol=1e-3):
        mirrored = np.linalg.det(rotation) < 0
        reason = "its axes are left-handed (determinant -1)" if mirrored else f"it scales by {scale:.4g}"
    else:
        reason = "its upper left 3 x 3 is not a rotation (rows must be orthonormal)"
    raise InputError(
        f"{where}: not a rigid transform: {reason}; it must be a rotation and a translation in metres"
    )


def check_intrinsics(value: Any, width: int, height: int, where: str) -> Array:
    """`value` as the 3x3 matrix of a pinhole camera with photos of `width` x `height` pixels."""
    matrix = numbers(value, (3, 3), where)
    right = f"it must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels of the {width} x {height} photo"
    (fx, skew, cx), (below, fy, cy) = matrix[:2]
    reason = None
    if not np.allclose(matrix[2], (0, 0, 1), atol=1e-6) or abs(below) > 1e-6 * max(abs(fx), 1):
        reason = "not a camera matrix (transposed, perhaps)"
    elif fx <= 0 or fy <= 0:
        reason = f"focal lengths {fx:g} and {fy:g} must be positive"
    elif abs(skew) > 0.01 * fx:
        reason = f"skew {skew:g} is not 0"
    elif min(fx / width, fy / height) < 0.1:
        reason = f"focal lengths {fx:g} and {fy:g} are too short (normalised, or in millimetres?)"
    elif not 0.5 < fx / fy < 2:
        reason = f"focal lengths {fx:g} and {fy:g} differ too much"
    elif abs(cx) <= 1 and abs(cy) <= 1:
        reason = f"principal point ({cx:g}, {cy:g}) is the photo's corner (normalised?)"
    elif not (-width <= cx <= 2 * width and -height <= cy <= 2 * height):
        reason = f"principal point ({cx:g}, {cy:g}) is far outside the photo (another resolution?)"
    if reason:
        raise InputError(f"{where}: {reason}; {right}")
    return matrix


def check_sensed(value: Any, width: int, height: int, where: str) -> Box | None:
    """`value` as the part of a padded photo that was measured; None for all of it."""
    if value is None:
        return None
    left, top, right, bottom = numbers(value, (4,), where).tolist()
    seen_width = min(right, width - 0.5) - max(left, -0.5)
    seen_height = min(bottom, height - 0.5) - max(top, -0.5)
    if min(seen_width, seen_height) < SMALLEST_PART:
        raise InputError(
            f"{where}: an empty part, or one of less than {SMALLEST_PART} pixels across; it must be "
            "[left, top, right, bottom] in pixels of the photo"
        )
    return (left, top, right, bottom)


def check_scene(scene: Observation, where: str) -> None:
    """Raises `InputError` where the cameras cannot have seen the workspace, with the likeliest cause."""
    cameras = [view.camera for view in scene.frames]
    workspace = scene.workspace
    middle = workspace.to_world(workspace.centre)
    for i, camera in enumerate(cameras):
        distance = float(np.linalg.norm(camera.centre - middle))
        if distance > FARTHEST_CAMERA:
            unit = next((unit for unit, count in UNITS.items() if _is_usual(distance / count)), None)
            guess = f"; the poses look like {unit}, they must be in metres" if unit else ""
            raise InputError(f"{where}, view {i}: camera {distance:.4g} m from the workspace{guess}")
    seen = [sees(camera, workspace) for camera in cameras]
    if not any(seen):
        raise InputError(f"{where}: the workspace is outside every view; {_likely_cause(cameras, workspace)}")
    for i, is_seen in enumerate(seen):
        if not is_seen:
            logger.warning("%s, view %d: the workspace is outside this view; it adds nothing", where, i)


def _is_usual(distance: float) -> bool:
    return USUAL_DISTANCES[0] < distance < USUAL_DISTANCES[1]


def sees(camera: Camera, workspace: Workspace) -> bool:
    """Whether any part of the workspace near the table lies in the camera's picture."""
    flat = (np.arange(7) + 0.5) * workspace.size / 7
    upright = workspace.table_height + np.linspace(0, workspace.photo_height, 3)
    points = np.stack(np.meshgrid(flat, flat, upright, indexing="ij"), axis=-1).reshape(-1, 3)
    pixels, depth = camera.project(workspace.to_world(points))
    left, top, right, bottom = camera.bounds
    u, v = pixels[:, 0], pixels[:, 1]
    return bool(np.any((depth > 0.01) & (u >= left) & (u < right) & (v >= top) & (v < bottom)))


def is_plausible(camera: Camera, workspace: Workspace) -> bool:
    """Whether a camera sees the workspace from above the table, and not from afar."""
    height = (inverse(workspace.world_from_workspace) @ camera.world_from_camera)[2, 3]
    distance = float(np.linalg.norm(camera.centre - workspace.to_world(workspace.centre)))
    return height > workspace.table_height and distance < FARTHEST_CAMERA and sees(camera, workspace)


def _likely_cause(cameras: list[Camera], workspace: Workspace) -> str:
    """Which common mistake, undone, brings the workspace into the views."""
    poses = [camera.world_from_camera for camera in cameras]
    mistakes = {
        "the poses look like OpenGL or Blender (y up, looking along -z); world_from_camera must be OpenCV "
        "(x right, y down, z forward): multiply by diag(1, -1, -1, 1) from the right": [
            pose @ OPENCV_FROM_OPENGL for pose in poses
        ],
        "the poses look like camera_from_world; world_from_camera is the inverse": [
            inverse(pose) for pose in poses
        ],
        "the cameras stand well about the origin, so world_from_workspace is probably wrong: it must give "
        "the lower corner of the cube, 0.05 m below the table": [
            workspace.world_from_workspace @ rigid(translation=workspace.centre) @ pose for pose in poses
        ],
    }
    for cause, mended in mistakes.items():
        tried = [replace(c, world_from_camera=pose) for c, pose in zip(cameras, mended, strict=True)]
        if all(sees(camera, workspace) for camera in tried):
            return cause
    return "check world_from_workspace, world_from_camera (OpenCV axes, metres) and intrinsics"
