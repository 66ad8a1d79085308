"""What will be in the hand after a grasp, as the reconstructed surface has it: a box around it."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy import ndimage

from neugrasp.detection.contract import Detection
from neugrasp.detection.things import ON_TABLE, matter
from neugrasp.geometry.pose import Array, apply, inverse
from neugrasp.grasp import Grasp

REACH = 0.03
"""Metres from the TCP within which matter is what the fingers close on."""
OFF_TABLE = 0.001
"""Metres above the table at which the box ends: what stands on the table does not touch it."""


def held_box(grasp: Grasp, detection: Detection) -> Array | None:
    """Corners (8, 3) of a box, in the user's world, around what a grasp takes with it, its upright edge
    changing first; None where nothing is seen there, or the detector has no surface.

    It is the connected matter between the two planes in which the pads close: what merely touches it
    elsewhere stays on the table. The box stands upright and is turned as the hand is.
    """
    if detection.tsdf is None:
        return None
    workspace = detection.workspace
    grasp = grasp.moved(inverse(workspace.world_from_workspace))
    centres = workspace.voxel_centres()
    across = np.abs((centres - grasp.position) @ grasp.pose[:3, 1])
    labels, _ = ndimage.label(
        matter(detection.tsdf, workspace) & (across <= grasp.width / 2 + workspace.voxel_size)
    )
    distance = np.where(labels > 0, np.linalg.norm(centres - grasp.position, axis=-1), np.inf)
    nearest = np.unravel_index(int(distance.argmin()), distance.shape)
    if distance[nearest] > REACH:
        return None
    turn = _upright(grasp)
    inside = centres[labels == labels[nearest]] @ turn
    half = workspace.voxel_size / 2
    low, high = inside.min(axis=0) - half, inside.max(axis=0) + half
    low[2] = max(low[2] - ON_TABLE, workspace.table_height + OFF_TABLE)
    corners = np.array(list(product(*zip(low, high, strict=True)))) @ turn.T
    return np.asarray(apply(workspace.world_from_workspace, corners))


def _upright(grasp: Grasp) -> Array:
    """Axes (3, 3), as columns, of a box on the table that is turned as the hand is."""
    x, y = grasp.pose[:2, 1] if np.linalg.norm(grasp.pose[:2, 1]) > 0.1 else grasp.pose[:2, 0]
    length = float(np.hypot(x, y))
    side = np.array([x / length, y / length, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    return np.stack([side, np.cross(up, side), up], axis=1)
