"""Poses in JSON files of other programs."""

from __future__ import annotations

from typing import Any

from neugrasp.data.camera_checks import check_rigid, numbers
from neugrasp.data.known_keys import refuse_bends
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, from_quaternion

KEYS = ("position", "quaternion_xyzw")


def pose_of(value: Any, where: str) -> Array:
    """A rigid transform: a 4 x 4 matrix, or {"position": [x, y, z], "quaternion_xyzw": [x, y, z, w]}."""
    if not isinstance(value, dict):
        return check_rigid(value, where)
    refuse_bends(value, KEYS, where)
    quaternion = numbers(value.get("quaternion_xyzw"), (4,), f"{where}: quaternion_xyzw")
    position = numbers(value.get("position"), (3,), f"{where}: position")
    norm = float((quaternion**2).sum()) ** 0.5
    if abs(norm - 1) > 1e-2:
        raise InputError(f"{where}: quaternion_xyzw has length {norm:.3g}; it must be 1")
    return from_quaternion(quaternion, position)
