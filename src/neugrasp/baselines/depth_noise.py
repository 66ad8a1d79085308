"""A cheap depth sensor: exact depth with multiplicative and blurred additive noise (GIGA's training data)."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import zoom

Depth = NDArray[np.float32]


@dataclass(frozen=True)
class NoisyDepth:
    """The noise that GIGA's data set was made with. The same image and seed give the same noise."""

    seed: int = 0
    gamma_shape: float = 1000.0
    """Shape of the factor Gamma(shape, 1 / shape) on a whole image: mean 1, deviation 1 / sqrt(shape)."""
    deviation: float = 0.005
    """Standard deviation of the additive noise, metres, in the half of all images that have it."""
    grain: int = 4
    """Pixels between independent additive values."""

    def __call__(self, depth: Depth) -> Depth:
        """What the sensor would measure; 0 stays 0."""
        rng = np.random.default_rng([self.seed, zlib.crc32(np.ascontiguousarray(depth).tobytes())])
        measured = depth * rng.gamma(self.gamma_shape, 1 / self.gamma_shape)
        if rng.random() < 0.5:
            height, width = depth.shape
            coarse = rng.normal(0, self.deviation, (-(-height // self.grain), -(-width // self.grain)))
            measured = measured + zoom(coarse, self.grain, order=1, mode="nearest")[:height, :width]
        noisy: Depth = np.where(depth > 0, np.maximum(measured, 1e-3), 0).astype(np.float32)
        return noisy
