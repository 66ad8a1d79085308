"""From where the scene is looked at first: beside the cameras, everything in the picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neugrasp.geometry.pose import Array, apply, inverse, look_at
from neugrasp.viewer.cameras import base
from neugrasp.viewer.scene_data import SceneData
from neugrasp.viewer.table_texture import edge

BESIDE = float(np.deg2rad(50))
"""Azimuth from the middle of the cameras: their photos are seen, and do not hide the table."""
POLAR = float(np.deg2rad(60))
FILLED = 0.95
"""The part of the picture that is filled, along the tighter side."""
TURNS = 20
"""Improvements of the eye's place; it settles after a few."""


@dataclass(frozen=True)
class Viewpoint:
    """An eye in the workspace frame."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    field_of_view: float = float(np.deg2rad(30))
    """Vertical, radians."""

    def pose(self) -> Array:
        """`workspace_from_camera`, OpenCV axes."""
        return look_at(self.eye, self.target)


def viewpoint(data: SceneData, aspect: float = 1.6) -> Viewpoint:
    """Beside the cameras, so near that cube and cameras just fit into a picture `aspect` times as wide as
    high."""
    workspace = data.workspace
    offset = np.zeros(3)
    if data.views:
        offset = np.mean([view.camera.centre for view in data.views], axis=0) - workspace.centre
    azimuth = float(np.arctan2(offset[1], offset[0])) + BESIDE
    direction = np.array(
        [np.sin(POLAR) * np.cos(azimuth), np.sin(POLAR) * np.sin(azimuth), np.cos(POLAR)], dtype=np.float64
    )
    target, distance, points = workspace.centre, 1.5, landmarks(data)
    for _ in range(TURNS):
        target, distance = _improved(points, target, direction, distance, aspect)
    return Viewpoint(_triple(target + distance * direction), _triple(target))


def landmarks(data: SceneData) -> Array:
    """Points (n, 3) that are to be seen: the cube above the table, the drawn table, and the cameras."""
    workspace = data.workspace
    x, y, z = workspace.centre
    half = edge(workspace) / 2
    table = np.array([(x + a * half, y + b * half, z) for a in (-1, 1) for b in (-1, 1)])
    points = [workspace.corners(bottom=z), table]
    for view in data.views:
        points += [view.camera.centre[None], base(view.camera)]
    return np.concatenate(points)


def _improved(
    points: Array, target: Array, direction: Array, distance: float, aspect: float
) -> tuple[Array, float]:
    """A target in the middle of what is seen, and a distance at which it fills the picture."""
    eye = Viewpoint(_triple(target + distance * direction), _triple(target))
    pose = eye.pose()
    seen = apply(inverse(pose), points)
    slopes = seen[:, :2] / np.maximum(seen[:, 2:], 0.05)
    low, high = slopes.min(axis=0), slopes.max(axis=0)
    target = target + pose[:3, :2] @ ((low + high) / 2 * distance)
    half = np.tan(eye.field_of_view / 2) * np.array([aspect, 1.0])
    return target, distance * float(np.max((high - low) / 2 / half)) / FILLED


def _triple(vector: Array) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z
