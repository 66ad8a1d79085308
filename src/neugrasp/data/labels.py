"""Grasps that were executed in simulation, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.npz import npz_arrays, npz_bytes

KINDS = {"points": "f", "quaternions": "f", "widths": "f", "success": "b"}


@dataclass(frozen=True)
class Labels:
    """Grasps that were executed in simulation, k of them."""

    points: NDArray[np.float32]
    """(k, 3) grasp points in the workspace frame, metres; not the TCP, see docs/conventions.md."""
    quaternions: NDArray[np.float32]
    """(k, 4) `workspace_from_grasp`, xyzw."""
    widths: NDArray[np.float32]
    """(k,) distance between the closed pads, metres; of a meaning only where the grasp succeeded."""
    success: NDArray[np.bool_]
    """(k,)"""


def labels_to_bytes(labels: Labels) -> bytes:
    """Labels as a compressed npz."""
    return npz_bytes(
        points=labels.points.astype(np.float32),
        quaternions=labels.quaternions.astype(np.float32),
        widths=labels.widths.astype(np.float32),
        success=labels.success.astype(bool),
    )


def labels_from_bytes(data: bytes, source: str) -> Labels:
    """The inverse of `labels_to_bytes`."""
    return Labels(**npz_arrays(data, KINDS, source))
