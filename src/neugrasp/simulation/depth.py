"""Exact depth images of a physics world."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, inverse

NEAR, FAR = 0.02, 4.0
"""z-depths in metres between which bodies are seen."""


def rendered(client: Any, camera: Camera) -> tuple[Array, NDArray[np.int64]]:
    """z-depth in metres (h, w), infinite where nothing is, and the numbers (h, w) of the bodies, -1 there."""
    # OpenGL looks along -z with y up.
    view = np.diag([1.0, -1.0, -1.0, 1.0]) @ inverse(camera.world_from_camera)
    image = client.getCameraImage(
        camera.width,
        camera.height,
        view.T.ravel().tolist(),
        _projection(camera).T.ravel().tolist(),
        shadow=0,
        renderer=client.ER_TINY_RENDERER,
    )
    shape = (camera.height, camera.width)
    buffer = np.asarray(image[3], dtype=np.float64).reshape(shape)
    uids = np.asarray(image[4], dtype=np.int64).reshape(shape)
    seen = (uids >= 0) & (buffer < 1)
    depth = np.where(seen, FAR * NEAR / (FAR - (FAR - NEAR) * buffer), np.inf)
    return depth, np.where(seen, uids, -1)


def _projection(camera: Camera) -> Array:
    """The OpenGL projection matrix of a pinhole camera.

    TinyRenderer samples at whole viewport coordinates and then flips the rows: our pixel (u, v) is its
    (u, h - 1 - v), hence the principal point at cx and, measured from the top edge, at cy + 1.
    """
    (fx, skew, cx), (_, fy, cy) = camera.intrinsics[:2]
    w, h = camera.width, camera.height
    return np.array(
        [
            [2 * fx / w, -2 * skew / w, 1 - 2 * cx / w, 0],
            [0, 2 * fy / h, 2 * (cy + 1) / h - 1, 0],
            [0, 0, -(FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR)],
            [0, 0, -1, 0],
        ]
    )


def plane_depth(camera: Camera, centre: Array, size: float) -> Array:
    """z-depth (h, w) at which each pixel's ray meets a level square from above; infinite where it misses."""
    # Every component of a ray of unit z-depth is affine in the pixel; spelled out, this is many times
    # faster than unprojecting an image of points.
    matrix = camera.world_from_camera[:3, :3] @ np.linalg.inv(camera.intrinsics)
    u, v = np.arange(camera.width)[None, :], np.arange(camera.height)[:, None]
    x, y, z = (a * u + (b * v + c) for a, b, c in matrix)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (centre[2] - camera.centre[2]) / z
        hit = (depth > 0) & (z < 0)
        for ray, start, middle in zip((x, y), camera.centre, centre, strict=False):
            hit &= np.abs(start - middle + depth * ray) <= size / 2
    return np.where(hit, depth, np.inf)
