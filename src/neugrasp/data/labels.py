"""Grasps that were executed, as arrays: the labels that the grasp head learns from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.npz import npz_arrays, npz_bytes
from neugrasp.errors import InputError

LABELS_FILE = "grasps.npz"
"""In the folder of a record or of a capture."""
KINDS = {"points": "f", "quaternions": "f", "widths": "f", "success": "b"}


@dataclass(frozen=True)
class GraspLabels:
    """Grasps that were executed in simulation or by a robot, k of them."""

    points: NDArray[np.float32]
    """(k, 3) grasp points in the workspace frame, metres; not the TCP, see docs/conventions.md."""
    quaternions: NDArray[np.float32]
    """(k, 4) `workspace_from_grasp`, xyzw."""
    widths: NDArray[np.float32]
    """(k,) opening with the object in hand, metres; it means something only where the grasp succeeded. In
    simulation about 4 mm more than the object's own width: the engine keeps 1 mm around each of the four
    surfaces that meet."""
    success: NDArray[np.bool_]
    """(k,)"""


def labels_to_bytes(labels: GraspLabels) -> bytes:
    """Labels as a compressed npz."""
    return npz_bytes(
        points=labels.points.astype(np.float32),
        quaternions=labels.quaternions.astype(np.float32),
        widths=labels.widths.astype(np.float32),
        success=labels.success.astype(bool),
    )


def labels_from_bytes(data: bytes, source: str) -> GraspLabels:
    """The inverse of `labels_to_bytes`. Raises `InputError` naming `source` where it is damaged."""
    labels = GraspLabels(**npz_arrays(data, KINDS, source))
    count = len(labels.success)
    for name, shape in {"points": (count, 3), "quaternions": (count, 4), "widths": (count,)}.items():
        found = getattr(labels, name).shape
        if found != shape:
            raise InputError(f"{source}: {name} has shape {found}; it must be {shape}")
    return labels
