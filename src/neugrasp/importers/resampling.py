"""Photos as an ideal pinhole would have taken them, and backgrounds as if from another camera's place."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from neugrasp.geometry.camera import Box
from neugrasp.geometry.lens import Lens
from neugrasp.geometry.pose import Array, inverse
from neugrasp.observation import Image

SAME_PLACE = 0.05
"""Pixels by which the table may shift between two cameras that count as one."""


def seen_on_table(lens: Lens, world_from_camera: Array, world_from_other: Array, table: Array) -> Array:
    """Where the other camera, of the same lens, sees what this one sees on the table: pixels (h, w, 2), both
    ideal pinholes; NaN where the line of sight misses the table or the other camera turns its back on it.

    `table` is (a, b, c, d) with a x + b y + c z = d in the world.
    """
    other_from_camera = inverse(world_from_other) @ world_from_camera
    normal = world_from_camera[:3, :3].T @ table[:3]
    height = table[3] - table[:3] @ world_from_camera[:3, 3]
    to_ray = np.linalg.inv(lens.intrinsics)
    # A ray meets the table at ray * height / (normal @ ray): the other camera sees that as a homography.
    homography = lens.intrinsics @ (
        other_from_camera[:3, :3] + np.outer(other_from_camera[:3, 3], normal) / height
    )
    grid = lens.pixel_grid()
    u, v, depth = (row[0] * grid[..., 0] + row[1] * grid[..., 1] + row[2] for row in homography @ to_ray)
    slope = normal @ to_ray
    is_ahead = height * (slope[0] * grid[..., 0] + slope[1] * grid[..., 1] + slope[2]) > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = np.stack([u / depth, v / depth], axis=-1)
    pixels[~(is_ahead & (depth > 0))] = np.nan
    return pixels


def is_in_place(lens: Lens, places: Array) -> bool:
    """Whether places (h, w, 2) are, but for noise, the pixels' own."""
    shift = np.abs(places - lens.pixel_grid())
    return bool(np.nanmax(shift, initial=0.0) < SAME_PLACE) and not np.isnan(shift).any()


def resampled(photo: Image, places: Array) -> Image:
    """The photo read, bilinearly, at places (h, w, 2) in pixels; what lies outside repeats the edge."""
    rows_and_columns = [np.nan_to_num(places[..., 1]), np.nan_to_num(places[..., 0])]
    channels = [
        ndimage.map_coordinates(photo[..., c].astype(np.float32), rows_and_columns, order=1, mode="nearest")
        for c in range(3)
    ]
    return np.stack(channels, axis=-1).round().clip(0, 255).astype(np.uint8)


def is_inside(lens: Lens, places: Array) -> np.ndarray:
    """Which of the places (h, w, 2) the photo of the lens shows; NaN counts as not."""
    with np.errstate(invalid="ignore"):
        inside: np.ndarray = np.all(
            (places >= -0.5) & (places <= [lens.width - 0.5, lens.height - 0.5]), axis=-1
        )
    return inside


def full_rectangle(inside: np.ndarray) -> Box | None:
    """A large rectangle of only true pixels in a mask (h, w); None for all of it. Edges in pixels.

    It shrinks from the side that has the most missing pixels: exact for what lenses and small motions do,
    where only borders are missing.
    """
    height, width = inside.shape
    top, bottom, left, right = 0, height, 0, width
    while top < bottom and left < right and not inside[top:bottom, left:right].all():
        part = inside[top:bottom, left:right]
        missing = [1 - part[0].mean(), 1 - part[-1].mean(), 1 - part[:, 0].mean(), 1 - part[:, -1].mean()]
        side = int(np.argmax(missing))
        top, bottom = top + (side == 0), bottom - (side == 1)
        left, right = left + (side == 2), right - (side == 3)
    if (left, top, right, bottom) == (0, 0, width, height):
        return None
    return (left - 0.5, top - 0.5, right - 0.5, bottom - 0.5)
