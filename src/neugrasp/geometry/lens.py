"""A lens as other programs describe it: a pinhole with the distortion of OpenCV."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from neugrasp.geometry.pose import Array

IDEAL_STEPS = 20
SLOPE_STEPS = 512
"""Radii at which the distortion is examined."""


@dataclass(frozen=True)
class Lens:
    """A pinhole with OpenCV's radial and tangential distortion; pixel centres at integers."""

    intrinsics: Float[np.ndarray, "3 3"]
    """Pixels, no skew."""
    width: int
    height: int
    """Height of the photos that it was calibrated for, pixels."""
    radial: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """k1, k2, k3."""
    tangential: tuple[float, float] = (0.0, 0.0)
    """p1, p2."""

    @property
    def is_distorted(self) -> bool:
        """Whether straight lines are bent."""
        return any((*self.radial, *self.tangential))

    @property
    def coefficients(self) -> Float[np.ndarray, " 5"]:
        """(k1, k2, p1, p2, k3), in OpenCV's order."""
        return np.array([*self.radial[:2], *self.tangential, self.radial[2]])

    def pixel_grid(self) -> Float[np.ndarray, "height width 2"]:
        """The centres of all pixels."""
        u, v = np.meshgrid(np.arange(self.width), np.arange(self.height))
        return np.stack([u, v], axis=-1).astype(np.float64)

    def normalised(self, pixels: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Pixels of the ideal pinhole as x / z and y / z in the camera's frame."""
        return np.asarray((pixels - self._centre) / self._focal)

    def distorted(self, pixels: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Where the photo really shows what an ideal pinhole would show at `pixels`.

        NaN where the polynomial folds back: beyond its own turning point it means nothing.
        """
        if not self.is_distorted:
            return pixels
        x, y = np.moveaxis(self.normalised(pixels), -1, 0)
        p1, p2 = self.tangential
        square = x * x + y * y
        stretch = self._stretch(square)
        bent = np.stack(
            [
                x * stretch + 2 * p1 * x * y + p2 * (square + 2 * x * x),
                y * stretch + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=-1,
        )
        bent[square > self._turning_point(float(square.max(initial=0.0)))] = np.nan
        return np.asarray(bent * self._focal + self._centre)

    def ideal(self, pixels: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Where an ideal pinhole would show what the photo shows at `pixels`, by substitution."""
        found = pixels.copy()
        for _ in range(IDEAL_STEPS if self.is_distorted else 0):
            found += np.nan_to_num(pixels - self.distorted(found))
        return found

    @property
    def _focal(self) -> Array:
        return np.array([self.intrinsics[0, 0], self.intrinsics[1, 1]])

    @property
    def _centre(self) -> Array:
        return self.intrinsics[:2, 2]

    def _stretch(self, square: Array) -> Array:
        """Distorted over ideal radius at squared ideal radii."""
        k1, k2, k3 = self.radial
        return np.asarray(1 + square * (k1 + square * (k2 + square * k3)))

    def _turning_point(self, largest: float) -> float:
        """The squared radius up to which a larger ideal radius means a larger distorted one."""
        radius = np.linspace(0, np.sqrt(largest), SLOPE_STEPS)
        falls = np.diff(radius * self._stretch(radius**2)) <= 0
        return float(radius[np.argmax(falls)] ** 2) if falls.any() else np.inf
