"""Photos of a table with a printed board on it, taken by a given camera: what a person would capture."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.lens import Lens
from neugrasp.geometry.pose import Array, apply, look_at
from neugrasp.importers.board import Board
from neugrasp.importers.markers import picture_of

DOTS_PER_METRE = 2000
SAMPLES = 2
"""In each direction of a pixel."""


def camera_at(eye: Array, target: Array, width: int = 640, height: int = 480, focal: float = 620.0) -> Camera:
    """A camera that looks at a point, the middle of its photo a little off the optical axis."""
    intrinsics = np.array([[focal, 0, width / 2 + 3.5], [0, focal, height / 2 - 6.25], [0, 0, 1]])
    return Camera(intrinsics, look_at(eye, target), width, height)


def photo_of_table(board: Board, camera: Camera, lens: Lens | None = None) -> np.ndarray:
    """The board on a cloudy table at z = 0 of the board's frame, without aliases.

    With a lens, the ideal pixels of `camera` appear where its distortion puts them.
    """
    offsets = (np.arange(SAMPLES) - (SAMPLES - 1) / 2) / SAMPLES
    rows = np.add.outer(np.arange(camera.height), offsets).ravel()
    columns = np.add.outer(np.arange(camera.width), offsets).ravel()
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1)
    if lens is not None:
        pixels = undistorted_points(lens, pixels)
    eye = camera.centre
    towards = camera.unproject(pixels, np.ones(pixels.shape[:-1])) - eye
    points = eye + towards * (-eye[2] / towards[..., 2:])
    colours = table_colour(board, points)
    shape = (camera.height, SAMPLES, camera.width, SAMPLES, 3)
    return colours.reshape(shape).mean(axis=(1, 3)).round().astype(np.uint8)


def table_colour(board: Board, points: Array) -> Array:
    """Colours (..., 3) of points on the table: grey clouds, and the board with a white margin."""
    x, y = points[..., 0], points[..., 1]
    clouds = 120 + 30 * np.sin(23 * x + 1) * np.cos(31 * y) + 25 * np.sin(57 * x - 40 * y)
    width, height = board.print.size
    picture = picture_of(board, DOTS_PER_METRE)[..., 0].astype(np.float64)
    rows, columns = (height - y) * DOTS_PER_METRE - 0.5, x * DOTS_PER_METRE - 0.5
    printed = ndimage.map_coordinates(picture, [rows, columns], order=1, mode="nearest")
    is_print = (x >= 0) & (x <= width) & (y >= 0) & (y <= height)
    is_paper = (x >= -0.01) & (x <= width + 0.01) & (y >= -0.01) & (y <= height + 0.01)
    grey = np.where(is_print, printed, np.where(is_paper, 235.0, clouds))
    return np.stack([grey, 0.9 * grey, 0.8 * grey], axis=-1)


def undistorted_points(lens: Lens, pixels: Array) -> Array:
    """Ideal pixels of those in the photo, by repeated substitution."""
    ideal = pixels.copy()
    for _ in range(12):
        ideal += pixels - lens.distorted(ideal)
    return ideal


def in_camera(camera: Camera, points: Array) -> Array:
    """Points of the board's frame in the camera's."""
    return apply(np.linalg.inv(camera.world_from_camera), points)
