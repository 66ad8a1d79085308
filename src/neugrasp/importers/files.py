"""JSON files of other programs, read with errors that name the file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from neugrasp.data.camera_checks import check_rigid, numbers
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, from_quaternion


def read_object(file: Path) -> dict[str, Any]:
    """The object in a JSON file. Raises `InputError` naming the file."""
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
        raise InputError(f"{file}: missing") from None
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise InputError(f"{file}: not valid JSON ({error})") from error
    if not isinstance(data, dict):
        raise InputError(f"{file}: must hold a JSON object")
    return data


def pose_of(value: Any, where: str) -> Array:
    """A rigid transform: a 4 x 4 matrix, or {"position": [x, y, z], "quaternion_xyzw": [x, y, z, w]}."""
    if not isinstance(value, dict):
        return check_rigid(value, where)
    quaternion = numbers(value.get("quaternion_xyzw"), (4,), f"{where}: quaternion_xyzw")
    position = numbers(value.get("position"), (3,), f"{where}: position")
    norm = float((quaternion**2).sum()) ** 0.5
    if abs(norm - 1) > 1e-2:
        raise InputError(f"{where}: quaternion_xyzw has length {norm:.3g}; it must be 1")
    return from_quaternion(quaternion, position)
