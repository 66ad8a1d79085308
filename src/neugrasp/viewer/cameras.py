"""Cameras as pyramids whose base is the measured part of the photo, exactly where its pixels project to."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from PIL import Image as Picture

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array
from neugrasp.observation import Image, View
from neugrasp.viewer.primitives import LinesNode, Node, PictureNode
from neugrasp.viewer.scene_data import Colour, SceneData

SIDE = 0.108
"""Metres of the longer side of a photo, as drawn."""
COLOUR: Colour = (60, 66, 78)
THICKNESS = 0.0015
MOST_PIXELS = 640
"""Pixels of the longer side of a photo sent to the browser."""


@lru_cache(maxsize=4)
def cameras(data: SceneData) -> tuple[Node, ...]:
    """A pyramid for every camera, and the photo where there is one."""
    nodes: list[Node] = []
    for i, view in enumerate(data.views):
        corners = base(view.camera)
        edges = [(view.camera.centre, corner) for corner in corners]
        edges += [(corners[k], corners[(k + 1) % 4]) for k in range(4)]
        nodes.append(LinesNode(f"cameras/{i}/pyramid", np.array(edges), COLOUR, THICKNESS))
        if isinstance(view, View):
            nodes.append(_photo(f"cameras/{i}/photo", view, corners))
    return tuple(nodes)


def base(camera: Camera) -> Array:
    """The corners (4, 3) of the drawn photo, clockwise from the upper left, metres."""
    left, top, right, bottom = measured(camera)
    edges = np.array([left, top, right, bottom]) - 0.5
    pixels = edges[[[0, 1], [2, 1], [2, 3], [0, 3]]]
    focal = np.array([camera.intrinsics[0, 0], camera.intrinsics[1, 1]])
    depth = SIDE / float(np.max(np.array([right - left, bottom - top]) / focal))
    return camera.unproject(pixels, [depth] * 4)


def measured(camera: Camera) -> tuple[int, int, int, int]:
    """First column and row of the pixels that were measured, and the first ones after them."""
    left, top, right, bottom = (round(side + 0.5) for side in camera.bounds)
    return left, top, max(right, left + 1), max(bottom, top + 1)


def _photo(name: str, view: View, corners: Array) -> PictureNode:
    # A photo lies on its plane as the camera sees it: x to the right, y down.
    pose = view.camera.world_from_camera.copy()
    pose[:3, 3] = corners.mean(axis=0)
    width, height = (float(np.linalg.norm(corners[k] - corners[0])) for k in (1, 3))
    left, top, right, bottom = measured(view.camera)
    return PictureNode(name, _small(view.image[top:bottom, left:right]), width, height, pose)


def _small(image: Image) -> Image:
    scale = MOST_PIXELS / max(image.shape[:2])
    if scale >= 1:
        return image
    size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
    return np.asarray(Picture.fromarray(image).resize(size, Picture.Resampling.BOX))
