"""A view at the resolution at which the network looks at it, with more of the table around the cube."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture
from scipy.spatial import ConvexHull, QhullError

from neugrasp.geometry.camera import Box, Camera
from neugrasp.geometry.pose import Array, inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import Image, View, Views

NETWORK_SIZE = 256
"""Pixels of the crop that the network reads; lengths in a table crop are in such pixels."""
GLANCE_SIZE = 96
"""The same for a glance: a seventh of the pixels. With 64 textured tables are in doubt too often."""
REACH = 2.2
"""Edge of a table crop over the edge of the network's: what lies around the cube is compared, too."""

Plane = NDArray[np.float32]
"""(h, w), or (h, w, 3) for colour, in [0, 1]."""
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class TableCrop:
    """A photo and the photo of the empty table, cut and shrunk alike, never enlarged."""

    index: int
    """Which view of the scene it is."""
    image: Plane
    """(h, w, 3) in [0, 1], as displayed (sRGB)."""
    background: Plane
    camera: Camera
    """Camera of the crop, in the workspace frame."""
    photo_pixels: float
    """Pixels of the photo that one pixel of the crop stands for, at least 1."""
    inside: Mask
    """(h, w): where the cube projects to, from under the table up to the height of objects."""
    box: Box
    """What was cut out of the photo, in its pixels."""

    def seen_by(self, camera: Camera, workspace: Workspace) -> Camera:
        """Its camera if `camera` (world frame, whole photo) had taken the photo; workspace frame."""
        moved = camera.moved(inverse(workspace.world_from_workspace))
        return moved.cropped_and_resized(self.box, self.camera.width, self.camera.height)


def table_crops(views: Views, size: int = NETWORK_SIZE) -> list[TableCrop]:
    """All views of a scene; `size` is that of the network's crop, in pixels of the table crops."""
    return [table_crop(view, i, views.workspace, size) for i, view in enumerate(views.frames)]


def table_crop(view: View, index: int, workspace: Workspace, size: int = NETWORK_SIZE) -> TableCrop:
    """The part of a view around the cube; all of the photo where the cube is not in it."""
    camera = view.camera.moved(inverse(workspace.world_from_workspace))
    crop = workspace.photo_box(camera)
    left, top, right, bottom = _whole_pixels(_around(crop, camera.bounds))
    shrink = max(1.0, (crop[2] - crop[0]) / size)
    width, height = max(8, round((right - left) / shrink)), max(8, round((bottom - top) / shrink))
    box = (left - 0.5, top - 0.5, right - 0.5, bottom - 0.5)
    small = camera.cropped_and_resized(box, width, height)

    def cut(photo: Image) -> Plane:
        # PIL counts from the left edge of the first pixel.
        picture = Picture.fromarray(photo).resize(
            (width, height), Picture.Resampling.BOX, box=(left, top, right, bottom), reducing_gap=None
        )
        return np.asarray(picture, dtype=np.float32) / 255

    return TableCrop(
        index, cut(view.image), cut(view.background), small, shrink, _inside(small, workspace), box
    )


def _around(crop: Box, bounds: Box) -> Box:
    """A square `REACH` times as large as the network's crop, cut to what was measured."""
    u, v, half = (crop[0] + crop[2]) / 2, (crop[1] + crop[3]) / 2, REACH * (crop[2] - crop[0]) / 2
    left, top = max(u - half, bounds[0]), max(v - half, bounds[1])
    right, bottom = min(u + half, bounds[2]), min(v + half, bounds[3])
    return (left, top, right, bottom) if right - left >= 8 and bottom - top >= 8 else bounds


def _whole_pixels(box: Box) -> tuple[int, int, int, int]:
    """The whole pixels inside a box, as PIL counts them."""
    left, top = (int(np.ceil(edge + 0.5 - 1e-6)) for edge in box[:2])
    right, bottom = (int(np.floor(edge + 0.5 + 1e-6)) for edge in box[2:])
    return left, top, right, bottom


def _inside(camera: Camera, workspace: Workspace) -> Mask:
    """The convex outline of the lower part of the cube; empty where the camera does not see it."""
    shape = (camera.height, camera.width)
    low, high = workspace.table_height - 0.01, workspace.table_height + workspace.photo_height
    pixels, depth = camera.project(workspace.corners(low, high))
    if np.any(depth < 0.01):
        return np.zeros(shape, dtype=bool)
    try:
        sides = ConvexHull(pixels).equations
    except (QhullError, ValueError):
        return np.zeros(shape, dtype=bool)
    u, v = np.arange(camera.width), np.arange(camera.height)[:, None]
    inside = np.ones(shape, dtype=bool)
    for across, down, offset in sides:
        inside &= across * u <= -(down * v + offset)
    return inside


def grey(picture: Plane) -> Array:
    """(h, w) brightness of a colour picture, as displayed."""
    return np.asarray(picture, dtype=np.float64) @ np.array([0.299, 0.587, 0.114])
