"""Rotations and rigid transforms as 4x4 float64 matrices: `a_from_b` maps b-coordinates to a-coordinates."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def rigid(
    rotation: ArrayLike | None = None, translation: ArrayLike = (0.0, 0.0, 0.0)
) -> Float64[np.ndarray, "4 4"]:
    """A transform from a 3x3 rotation (identity by default) and a translation in metres."""
    transform = np.eye(4)
    if rotation is not None:
        transform[:3, :3] = rotation
    transform[:3, 3] = translation
    return transform


def inverse(a_from_b: ArrayLike) -> Float64[np.ndarray, "4 4"]:
    """`b_from_a` of a rigid transform."""
    matrix = np.asarray(a_from_b, dtype=np.float64)
    rotation = matrix[:3, :3].T
    return rigid(rotation, -rotation @ matrix[:3, 3])


def apply(a_from_b: ArrayLike, points_b: ArrayLike) -> Float64[np.ndarray, "*points 3"]:
    """Points (..., 3) of frame b in frame a."""
    matrix = np.asarray(a_from_b, dtype=np.float64)
    return np.asarray(points_b, dtype=np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def from_quaternion(
    quaternion_xyzw: ArrayLike, translation: ArrayLike = (0.0, 0.0, 0.0)
) -> Float64[np.ndarray, "4 4"]:
    """A transform from a quaternion (x, y, z, w) and a translation in metres."""
    return rigid(Rotation.from_quat(quaternion_xyzw).as_matrix(), translation)


def to_quaternion(a_from_b: ArrayLike) -> Float64[np.ndarray, " 4"]:
    """The rotation of a transform as a unit quaternion (x, y, z, w) with w >= 0."""
    quaternion: Array = Rotation.from_matrix(np.asarray(a_from_b, dtype=np.float64)[:3, :3]).as_quat()
    return -quaternion if quaternion[3] < 0 else quaternion


def from_rotation_vector(
    vector: ArrayLike, translation: ArrayLike = (0.0, 0.0, 0.0)
) -> Float64[np.ndarray, "4 4"]:
    """A transform from a rotation vector (along the axis, as long as the angle in radians) and metres."""
    return rigid(Rotation.from_rotvec(vector).as_matrix(), translation)


def to_rotation_vector(a_from_b: ArrayLike) -> Float64[np.ndarray, " 3"]:
    """The rotation of a transform as a vector along its axis, as long as its angle, 0 to pi radians."""
    vector: Array = Rotation.from_matrix(np.asarray(a_from_b, dtype=np.float64)[:3, :3]).as_rotvec()
    return vector


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> Float64[np.ndarray, "4 4"]:
    """`world_from_camera` of an OpenCV camera (x right, y down, z forward) at `eye` that looks at `target`.

    Where the line of sight is parallel to `up`, the world's y axis stands in for it.
    """
    eye = np.asarray(eye, dtype=np.float64)
    forward = np.asarray(target, dtype=np.float64) - eye
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, np.asarray(up, dtype=np.float64))
    if np.linalg.norm(right) < 1e-6:
        right = np.cross(forward, (0.0, 1.0, 0.0))
    right = right / np.linalg.norm(right)
    return rigid(np.stack([right, np.cross(forward, right), forward], axis=1), eye)


def rotation_about(axis: ArrayLike, angle: float) -> Float64[np.ndarray, "3 3"]:
    """A rotation by `angle` radians about `axis`."""
    axis = np.asarray(axis, dtype=np.float64)
    matrix: Array = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()
    return matrix


def is_rigid(transform: ArrayLike, tolerance: float = 1e-3) -> bool:
    """Whether a 4x4 matrix is a rotation (determinant +1) and a translation."""
    matrix = np.asarray(transform, dtype=np.float64)
    if matrix.shape != (4, 4) or not np.all(np.isfinite(matrix)):
        return False
    rotation = matrix[:3, :3]
    return (
        bool(np.allclose(rotation @ rotation.T, np.eye(3), atol=tolerance))
        and bool(np.linalg.det(rotation) > 0)
        and bool(np.allclose(matrix[3], (0, 0, 0, 1), atol=tolerance))
    )
