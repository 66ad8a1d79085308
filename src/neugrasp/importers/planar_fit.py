"""How well a flat layout and the pixels in which it was seen fit together, whatever the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neugrasp.geometry.pose import Array

LEAST_LIMIT = 0.6
"""Pixels: corners of chessboards are found within a tenth of a pixel, those of tags within a quarter. One of
three tags that lies 3 mm beside its place makes 0.7 in a photo of 640 x 480 and moves the camera by 20 mm."""
SHARE_LIMIT = 0.0008
"""Share of the photo's diagonal: large photos are no sharper, and their lenses no straighter."""


@dataclass(frozen=True)
class Fit:
    """A homography from the layout's plane to ideal pixels."""

    matrix: Array
    """3x3, from x, y in metres to pixels."""
    errors: Array
    """(n,) distances in pixels of the points from where it puts them."""

    @property
    def error(self) -> float:
        """Root mean square."""
        return float(np.sqrt((self.errors**2).mean()))


def limit_of(width: int, height: int) -> float:
    """Pixels of root mean square error up to which a layout is believed in a photo of that size."""
    return max(LEAST_LIMIT, SHARE_LIMIT * float(np.hypot(width, height)))


def fit(points: Array, pixels: Array) -> Fit:
    """The homography that fits points (n, 2 or 3), z aside, and pixels (n, 2) best; n >= 4."""
    source, centre, scale = _normalised(points[:, :2])
    target, middle, spread = _normalised(pixels)
    x, y = source.T
    u, v = target.T
    one, none = np.ones_like(x), np.zeros_like(x)
    rows = np.concatenate(
        [
            np.stack([x, y, one, none, none, none, -u * x, -u * y, -u], axis=-1),
            np.stack([none, none, none, x, y, one, -v * x, -v * y, -v], axis=-1),
        ]
    )
    matrix = np.linalg.svd(rows)[2][-1].reshape(3, 3)
    to_source = np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])
    from_target = np.array([[1 / spread, 0, middle[0]], [0, 1 / spread, middle[1]], [0, 0, 1]])
    whole = from_target @ matrix @ to_source
    return Fit(whole, np.linalg.norm(mapped(whole, points) - pixels, axis=-1))


def mapped(matrix: Array, points: Array) -> Array:
    """Pixels (n, 2) of points (n, 2 or 3) by a homography."""
    homogeneous = np.concatenate([points[:, :2], np.ones((len(points), 1))], axis=-1) @ matrix.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])


def _normalised(points: Array) -> tuple[Array, Array, float]:
    centre = points.mean(axis=0)
    spread = float(np.sqrt(((points - centre) ** 2).sum(axis=-1).mean())) or 1.0
    return (points - centre) / spread, centre, 1 / spread
