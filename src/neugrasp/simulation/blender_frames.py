"""Our cameras and places in Blender's conventions: plain arithmetic, testable without Blender."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from neugrasp.geometry.camera import Box, Camera
from neugrasp.geometry.pose import Array, rigid

SENSOR_WIDTH = 36.0
"""Millimetres; Blender's own default."""
OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""Blender's cameras look along -z with y up."""


@dataclass(frozen=True)
class Lens:
    """A pinhole camera as Blender describes it, with the sensor fitted horizontally."""

    focal: float
    """Millimetres, of a sensor 36 mm wide."""
    shift: tuple[float, float]
    """Where the optical axis leaves the middle of the image, in image widths, x and y up."""
    pixel_aspect: tuple[float, float]
    world_from_camera: Array


def lens_of(camera: Camera) -> Lens:
    """The lens that takes the same picture as a camera with its principal point anywhere."""
    (fx, _, cx), (_, fy, cy) = camera.intrinsics[:2]
    middle_x, middle_y = (camera.width - 1) / 2, (camera.height - 1) / 2
    return Lens(
        focal=float(fx * SENSOR_WIDTH / camera.width),
        shift=(float((middle_x - cx) / camera.width), float((cy - middle_y) / camera.width * fx / fy)),
        pixel_aspect=(max(1.0, float(fy / fx)), max(1.0, float(fx / fy))),
        world_from_camera=camera.world_from_camera @ OPENCV_FROM_OPENGL,
    )


def pixels_inside(bounds: Box) -> tuple[int, int, int, int]:
    """The whole pixels that a region touches: left, top, right, bottom, the last two exclusive."""
    left, top = (int(np.floor(edge + 0.5 + 1e-6)) for edge in bounds[:2])
    right, bottom = (int(np.ceil(edge + 0.5 - 1e-6)) for edge in bounds[2:])
    return left, top, right, bottom


def upright(foot: ArrayLike, azimuth: float, distance: float) -> Array:
    """The place of a plane that stands at a distance from `foot` and faces it."""
    inwards = -np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    return rigid(
        np.stack([np.cross(up, inwards), up, inwards], axis=1), np.asarray(foot) - distance * inwards
    )


def facing(position: ArrayLike, target: ArrayLike) -> Array:
    """The place of a lamp at `position` whose -z axis points at `target`."""
    z = np.asarray(position, dtype=np.float64) - np.asarray(target, dtype=np.float64)
    z = z / np.linalg.norm(z)
    helper = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = np.cross(helper, z)
    x = x / np.linalg.norm(x)
    return rigid(np.stack([x, np.cross(z, x), z], axis=1), position)
