"""One pinhole camera. OpenCV axes, pixel centres at integers: the image spans [-0.5, width - 0.5]."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from neugrasp.geometry.pose import apply, inverse

Box = tuple[float, float, float, float]
"""Left, top, right, bottom in pixels; edges, not centres: a whole image is (-0.5, -0.5, w - 0.5, h - 0.5)."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with its place in the world."""

    intrinsics: Float[np.ndarray, "3 3"]
    """Pixels."""
    world_from_camera: Float[np.ndarray, "4 4"]
    """Rigid transform, metres."""
    width: int
    height: int
    sensed: Box | None = None
    """The part of the image that holds measured pixels; None for all of it. A crop that reaches past the
    photo it was taken from is padded, and what projects into the padding was not seen."""

    @property
    def bounds(self) -> Box:
        """The region (left, top, right, bottom) inside which a projected point counts as seen."""
        whole = (-0.5, -0.5, self.width - 0.5, self.height - 0.5)
        if self.sensed is None:
            return whole
        left, top, right, bottom = self.sensed
        return (max(left, whole[0]), max(top, whole[1]), min(right, whole[2]), min(bottom, whole[3]))

    @property
    def centre(self) -> Float[np.ndarray, " 3"]:
        """The optical centre in the world, metres."""
        return self.world_from_camera[:3, 3]

    def project(
        self, points_world: ArrayLike
    ) -> tuple[Float[np.ndarray, "*points 2"], Float[np.ndarray, "*points"]]:
        """Pixels and z-depths of world points (..., 3). Depth <= 0 lies behind the camera."""
        points = apply(inverse(self.world_from_camera), points_world)
        depth = points[..., 2]
        safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
        pixels = (points / safe[..., None]) @ self.intrinsics.T
        return pixels[..., :2], depth

    def unproject(self, pixels: ArrayLike, depth: ArrayLike) -> Float[np.ndarray, "*points 3"]:
        """World points of pixels (..., 2) at z-depths (...) in metres."""
        pixels = np.asarray(pixels, dtype=np.float64)
        homogeneous = np.concatenate([pixels, np.ones((*pixels.shape[:-1], 1))], axis=-1)
        directions = homogeneous @ np.linalg.inv(self.intrinsics).T
        return apply(self.world_from_camera, directions * np.asarray(depth, dtype=np.float64)[..., None])

    def pixel_grid(self) -> Float[np.ndarray, "height width 2"]:
        """The centres of all pixels."""
        u, v = np.meshgrid(np.arange(self.width), np.arange(self.height))
        return np.stack([u, v], axis=-1).astype(np.float64)

    def measured_pixels(self) -> Bool[np.ndarray, "height width"]:
        """Which pixels lie inside `bounds`: of the photo, and not of what pads its crop."""
        left, top, right, bottom = self.bounds
        u, v = np.arange(self.width), np.arange(self.height)
        across, down = (u > left) & (u < right), (v > top) & (v < bottom)
        inside: np.ndarray = down[:, None] & across
        return inside

    def cropped_and_resized(self, box: Box, width: int, height: int) -> Camera:
        """The camera of the image cut out of `box` (edges, pixels) and resampled to `width` x `height`.

        The box may reach past the image; `sensed` of the result says which part was measured.
        """
        left, top, right, bottom = box
        scale = np.array([width / (right - left), height / (bottom - top)])
        offset = np.array([left, top])

        def moved(pixel: ArrayLike) -> np.ndarray:
            return (np.asarray(pixel, dtype=np.float64) - offset) * scale - 0.5

        intrinsics = self.intrinsics.copy()
        intrinsics[:2, :2] *= scale[:, None]
        intrinsics[:2, 2] = moved(self.intrinsics[:2, 2])
        seen = self.bounds
        sensed = (*moved(seen[:2]), *moved(seen[2:]))
        return replace(self, intrinsics=intrinsics, width=width, height=height, sensed=sensed)

    def moved(self, new_from_world: ArrayLike) -> Camera:
        """The same camera with its place given in another frame."""
        return replace(self, world_from_camera=np.asarray(new_from_world) @ self.world_from_camera)
