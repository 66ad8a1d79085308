"""Places around the table in spherical coordinates: where cameras stand, and from where a figure is seen."""

from __future__ import annotations

import numpy as np

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, apply, inverse, look_at
from neugrasp.geometry.workspace import Workspace

FILLED = 0.92
"""The part of a picture that is filled, along the tighter side."""
FAR = 2.5
"""Metres to the eye: parallel lines stay nearly so."""


def spherical(points: Array, workspace: Workspace) -> Array:
    """Polar angle, azimuth and radius (n, 3) about the middle of the table of points (n, 3) of the workspace
    frame; azimuths go on without a jump."""
    offset = points - workspace.centre
    radius = np.linalg.norm(offset, axis=1)
    azimuth = np.unwrap(np.arctan2(offset[:, 1], offset[:, 0]))
    return np.stack([np.arccos(offset[:, 2] / radius), azimuth, radius], axis=1)


def from_spherical(places: Array, workspace: Workspace) -> Array:
    """The inverse of `spherical`."""
    polar, azimuth, radius = places.T
    ring = np.sin(polar)
    direction = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), np.cos(polar)], axis=1)
    points: Array = workspace.centre + radius[:, None] * direction
    return points


def way_between(centres: Array, workspace: Workspace, pieces: int = 20) -> Array:
    """The spiral (m, 3) through centres of cameras (n, 3), in their order: angles and radii change evenly."""
    places = spherical(centres, workspace)
    times = np.linspace(0, len(places) - 1, pieces * (len(places) - 1) + 1)
    known = np.arange(len(places))
    smooth = np.stack([np.interp(times, known, places[:, k]) for k in range(3)], axis=1)
    return from_spherical(smooth, workspace)


def eye_that_sees(
    points: Array, workspace: Workspace, polar: float, azimuth: float, size: tuple[int, int]
) -> Camera:
    """A distant camera at two angles whose picture of `size` (width, height) the points (n, 3) just fill."""
    place = from_spherical(np.array([[polar, azimuth, FAR]]), workspace)[0]
    pose = look_at(place, workspace.centre)
    seen = apply(inverse(pose), points)
    slopes = seen[:, :2] / seen[:, 2:]
    low, high = slopes.min(axis=0), slopes.max(axis=0)
    focal = FILLED * float(np.min(np.array(size) / (high - low)))
    u, v = np.array(size) / 2 - 0.5 - focal * (low + high) / 2
    return Camera(np.array([[focal, 0, u], [0, focal, v], [0, 0, 1.0]]), pose, *size)
