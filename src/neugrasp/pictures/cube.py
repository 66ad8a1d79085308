"""The cube and the table plane drawn into a photo: shows at a glance whether a capture is understood."""

from __future__ import annotations

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import Image

OVERSAMPLING = 2
NEAR = 0.01
"""Metres; what is nearer to the camera is not drawn."""
GRID = 6
"""Squares along an edge of the table."""
TABLE, CUBE = (255, 210, 40), (40, 220, 255)
AXES = ((230, 60, 50), (70, 200, 70), (70, 110, 255))
"""x, y and z at the lower corner of the cube."""


def draw_cube(photo: Image, camera: Camera, workspace: Workspace, width: int = 640) -> Image:
    """The whole photo, `width` pixels wide, with the cube (cyan), the table inside it (yellow grid) and the
    axes of the workspace (red, green, blue). `camera` is in the world frame."""
    scale = width / camera.width
    height = round(camera.height * scale)
    whole = (-0.5, -0.5, camera.width - 0.5, camera.height - 0.5)
    camera = camera.moved(inverse(workspace.world_from_workspace))
    camera = camera.cropped_and_resized(whole, width * OVERSAMPLING, height * OVERSAMPLING)
    layer = Picture.new("RGBA", (camera.width, camera.height), (0, 0, 0, 0))
    pen = ImageDraw.Draw(layer)
    thin = max(2, round(camera.width / 320))
    for start, end in _table_lines(workspace):
        _line(pen, camera, (start, end), (*TABLE, 200), thin)
    for start, end in _edges(workspace):
        _line(pen, camera, (start, end), (*CUBE, 230), thin)
    for axis, colour in zip(np.eye(3), AXES, strict=True):
        _line(pen, camera, (np.zeros(3), axis * workspace.size / 3), (*colour, 255), 3 * thin)
    layer = layer.resize((width, height), Picture.Resampling.BOX)
    picture = Picture.fromarray(photo).resize((width, height), Picture.Resampling.BICUBIC)
    picture.paste(layer, mask=layer.getchannel("A"))
    return np.asarray(picture)


def _table_lines(workspace: Workspace) -> list[tuple[Array, Array]]:
    size, height = workspace.size, workspace.table_height
    lines = []
    for place in np.linspace(0, size, GRID + 1):
        lines.append((np.array([place, 0, height]), np.array([place, size, height])))
        lines.append((np.array([0, place, height]), np.array([size, place, height])))
    return lines


def _edges(workspace: Workspace) -> list[tuple[Array, Array]]:
    """The 12 edges: pairs of corners that differ in one coordinate."""
    corners = workspace.corners()
    pairs = [(a, b) for i, a in enumerate(corners) for b in corners[i + 1 :]]
    return [(a, b) for a, b in pairs if np.count_nonzero(a != b) == 1]


def _line(
    pen: ImageDraw.ImageDraw,
    camera: Camera,
    ends: tuple[Array, Array],
    ink: tuple[int, int, int, int],
    thickness: int,
) -> None:
    """A straight line of space, in short pieces; those behind the camera are left out."""
    pieces = ends[0] + np.linspace(0, 1, 25)[:, None] * (ends[1] - ends[0])
    pixels, depth = camera.project(pieces)
    limit = 20.0 * max(camera.width, camera.height)
    for i in range(len(pieces) - 1):
        pair = pixels[i : i + 2]
        if depth[i : i + 2].min() > NEAR and np.abs(pair).max() < limit:
            # Pixel centres lie at integers here and at halves in PIL.
            pen.line([tuple(point) for point in (pair + 0.5).tolist()], fill=ink, width=thickness)
