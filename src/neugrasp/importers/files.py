"""Poses in JSON files of other programs."""

from __future__ import annotations

from typing import Any

import numpy as np

from neugrasp.data.camera_checks import check_rigid, numbers
from neugrasp.data.known_keys import refuse_bends, refuse_unknown
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, from_quaternion, from_rotation_vector

WHOLE_TURN = 2 * np.pi + 1e-3
"""Radians; robots keep rotation vectors to at most this."""
KEYS = ("position", "quaternion_xyzw", "rotation_vector")


def pose_of(value: Any, where: str) -> Array:
    """A rigid transform: a 4 x 4 matrix, {"position": [x, y, z], "quaternion_xyzw": [x, y, z, w]}, or
    {"position": [x, y, z], "rotation_vector": [rx, ry, rz]}, along the axis and as long as the angle in
    radians. Raises `InputError`."""
    if not isinstance(value, dict):
        return check_rigid(value, where)
    refuse_bends(value, KEYS, where)
    refuse_unknown(value, KEYS, where)
    if "rotation_vector" in value:
        return _from_vector(value, where)
    quaternion = numbers(value.get("quaternion_xyzw"), (4,), f"{where}: quaternion_xyzw")
    position = numbers(value.get("position"), (3,), f"{where}: position")
    norm = float((quaternion**2).sum()) ** 0.5
    if abs(norm - 1) > 1e-2:
        raise InputError(f"{where}: quaternion_xyzw has length {norm:.3g}; it must be 1")
    return from_quaternion(quaternion, position)


def _from_vector(value: dict[str, Any], where: str) -> Array:
    if "quaternion_xyzw" in value:
        raise InputError(f"{where}: has both quaternion_xyzw and rotation_vector; which one is meant?")
    vector = numbers(value["rotation_vector"], (3,), f"{where}: rotation_vector")
    length = float(np.linalg.norm(vector))
    if length > WHOLE_TURN:
        raise InputError(
            f"{where}: rotation_vector is {length:.3g} long, more than a whole turn; it must be in radians, "
            "along the axis (Universal Robots: rx, ry, rz), not roll, pitch and yaw in degrees"
        )
    return from_rotation_vector(vector, numbers(value.get("position"), (3,), f"{where}: position"))
