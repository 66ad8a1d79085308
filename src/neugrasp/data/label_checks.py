"""Whether labels that a user wrote down can be grasps of his cube; if not, which mistake they look like."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from neugrasp.data.labels import GraspLabels
from neugrasp.errors import InputError
from neugrasp.geometry.pose import apply, inverse
from neugrasp.geometry.workspace import Workspace

WIDEST = 0.5
"""Metres between the pads of a gripper."""
BELOW, FROM_BELOW = 0.01, 0.2
"""Metres under the table, and upward part of an approach, that few grasps which held have."""

log = logging.getLogger(__name__)


def check_labels(labels: GraspLabels, workspace: Workspace, source: str) -> GraspLabels:
    """The same labels. A trainer leaves out what lies outside of the cube: here it is told, or refused.

    Raises `InputError` naming the source.
    """
    points, count = labels.points.astype(np.float64), len(labels.points)
    _check_each(labels, source)
    outside = int(np.sum(~workspace.contains(points)))
    if 2 * outside > count:
        guess = _guess(points, workspace)
        raise InputError(
            f"{source}: {outside} of {count} grasp points lie outside of the cube{guess}; they are in "
            "metres, from the lower corner of the cube (docs/data_format.md)"
        )
    if outside:
        log.warning("%s: %d of %d grasp points lie outside of the cube: left out", source, outside, count)
    held, count = labels.success, int(labels.success.sum())
    low = int(np.sum(points[held, 2] < workspace.table_height - BELOW))
    if 2 * low > count:
        raise InputError(
            f"{source}: {low} of {count} grasps that held lie below the table; z counts from the floor of "
            f"the cube, {workspace.table_height:g} m under the table"
        )
    up = int(np.sum(_upward(labels.quaternions[held]) > FROM_BELOW))
    if 2 * up > count:
        raise InputError(
            f"{source}: {up} of {count} grasps that held came from below the table; quaternions are "
            "(x, y, z, w), and their z axis approaches"
        )
    return labels


def _check_each(labels: GraspLabels, source: str) -> None:
    lengths = np.linalg.norm(labels.quaternions.astype(np.float64), axis=1)
    if np.any(np.abs(lengths - 1) > 0.01):
        worst = lengths[np.abs(lengths - 1).argmax()]
        raise InputError(f"{source}: a quaternion has length {worst:.3g}; each must have 1")
    widths = labels.widths[labels.success]
    if np.any((widths <= 0) | (widths > WIDEST)):
        worst = widths[np.abs(widths - WIDEST / 2).argmax()]
        raise InputError(f"{source}: a grasp held {worst:.3g} m wide; widths are from 0 to {WIDEST:g} m")


def _guess(points: NDArray[np.float64], workspace: Workspace) -> str:
    """Which mistake, undone, brings most of the points into the cube."""
    meant = {
        " (they look like millimetres)": points / 1000,
        " (they look like those of the world)": apply(inverse(workspace.world_from_workspace), points),
    }
    return next((why for why, p in meant.items() if 2 * workspace.contains(p).sum() > len(p)), "")


def _upward(quaternions: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """(k,) the upward part of the approaches of orientations (k, 4), xyzw."""
    if not len(quaternions):
        return np.zeros(0)
    return np.asarray(Rotation.from_quat(quaternions).apply([0.0, 0.0, 1.0])[:, 2])
