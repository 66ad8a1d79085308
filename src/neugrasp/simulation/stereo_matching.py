"""Depth from a rectified pair of infrared images, as a stereo sensor finds it (DREDS).

Zero-mean normalised cross-correlation of windows, a parabola for sub-pixels, a check from left to right and
back, then a median and a bilateral filter. What does not match, or matches something else, is no measurement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter

Grey = NDArray[np.float32]
"""(h, w), any scale."""
Volume = NDArray[np.float32]
"""(disparity, h, w) correlations; -1 where there is nothing to compare."""
NOTHING = -1.0


@dataclass(frozen=True)
class StereoConfig:
    """The paper's sensor; lengths in pixels are those of images 320 pixels wide, half the paper's."""

    baseline: float = 0.055
    """Metres from the left to the right camera."""
    window: int = 7
    """Edge of the compared squares, pixels."""
    max_mismatch: float = 0.5**0.5
    """Pixels by which the way back may miss the start."""
    median: int = 3
    bilateral: int = 5
    bilateral_space: float = 1.5
    """Standard deviation, pixels."""
    bilateral_disparity: float = 1.1
    """Standard deviation, pixels of disparity."""
    min_contrast: float = 0.5
    """Standard deviation of a window, grey levels of 255, below which it cannot be recognised."""
    nearest: float = 0.23
    farthest: float = 0.80
    """z-depths in metres between which matches are sought."""


def stereo_depth(left: Grey, right: Grey, offset: int, focal: float, config: StereoConfig) -> Grey:
    """z-depth (h, w) of the left image in metres, 0 where nothing was measured; grey levels 0 to 255.

    Column u of `left` and column u + `offset` of `right` look in the same direction. `focal` is in pixels.
    """
    lowest = max(1, int(np.floor(focal * config.baseline / config.farthest)))
    highest = int(np.ceil(focal * config.baseline / config.nearest))
    disparities = np.arange(lowest - 1, highest + 2)
    volume = correlations(left, right, offset, disparities, config)
    forth, found = _best(volume)
    back, found_back = _best(_seen_from_right(volume, right.shape[1], offset, disparities))
    forth, back = forth + disparities[0], np.where(found_back, back + disparities[0], np.inf)
    valid = found & _agree(forth, back, offset, config.max_mismatch)
    smooth = _bilateral(median_filter(forth, config.median, mode="nearest"), config)
    depth: Grey = np.where(valid, focal * config.baseline / np.maximum(smooth, 1e-6), 0).astype(np.float32)
    return depth


def correlations(
    left: Grey, right: Grey, offset: int, disparities: NDArray[np.int64], config: StereoConfig
) -> Volume:
    """How alike the windows about (v, u) on the left and (v, u + offset - disparity) on the right are."""
    left_mean, left_spread = _moments(left, config.window)
    right_mean, right_spread = _moments(right, config.window)
    volume = np.full((len(disparities), *left.shape), NOTHING, dtype=np.float32)
    for plane, disparity in zip(volume, disparities.tolist(), strict=True):
        shift = offset - disparity
        start, stop = max(0, -shift), min(left.shape[1], right.shape[1] - shift)
        if stop <= start:
            continue
        here, there = slice(start, stop), slice(start + shift, stop + shift)
        product = uniform_filter(left[:, here] * right[:, there], config.window, mode="nearest")
        spread = left_spread[:, here] * right_spread[:, there]
        covariance = product - left_mean[:, here] * right_mean[:, there]
        known = (left_spread[:, here] > config.min_contrast) & (right_spread[:, there] > config.min_contrast)
        plane[:, here] = np.where(known, covariance / np.maximum(spread, 1e-6), NOTHING)
    return volume


def _moments(image: Grey, window: int) -> tuple[Grey, Grey]:
    """Mean and standard deviation in the window about every pixel."""
    mean = uniform_filter(image, window, mode="nearest")
    square = uniform_filter(image * image, window, mode="nearest")
    return mean, np.sqrt(np.maximum(square - mean * mean, 0))


def _seen_from_right(volume: Volume, width: int, offset: int, disparities: NDArray[np.int64]) -> Volume:
    """The same correlations at the pixels of the right image."""
    turned = np.full((len(volume), volume.shape[1], width), NOTHING, dtype=np.float32)
    for plane, source, disparity in zip(turned, volume, disparities.tolist(), strict=True):
        shift = offset - disparity
        start, stop = max(0, -shift), min(source.shape[1], width - shift)
        if stop > start:
            plane[:, start + shift : stop + shift] = source[:, start:stop]
    return turned


def _best(volume: Volume) -> tuple[Grey, NDArray[np.bool_]]:
    """The index of the best disparity, to a fraction, and whether it lies between two worse ones."""
    index = np.clip(volume.argmax(axis=0), 1, len(volume) - 2)
    below, middle, above = (
        np.take_along_axis(volume, (index + step)[None], axis=0)[0] for step in (-1, 0, 1)
    )
    curvature = below - 2 * middle + above
    is_peak = (middle >= below) & (middle >= above) & (curvature < 0) & (middle > 0)
    fraction = np.where(is_peak, (below - above) / np.where(curvature < 0, 2 * curvature, 1), 0)
    return (index + np.clip(fraction, -0.5, 0.5)).astype(np.float32), is_peak


def _agree(forth: Grey, back: Grey, offset: int, tolerance: float) -> NDArray[np.bool_]:
    """Whether the way from the left pixel to its partner leads back to it; disparities, infinite for none."""
    rows, columns = np.indices(forth.shape)
    there = np.rint(columns + offset - forth).astype(np.int64)
    inside = (there >= 0) & (there < back.shape[1])
    returned = back[rows, np.clip(there, 0, back.shape[1] - 1)]
    return np.asarray(inside & (np.abs(returned - forth) <= tolerance))


def _bilateral(image: Grey, config: StereoConfig) -> Grey:
    reach = config.bilateral // 2
    neighbours = sliding_window_view(np.pad(image, reach, mode="edge"), (config.bilateral,) * 2)
    total, weights = np.zeros_like(image), np.zeros_like(image)
    for i in range(config.bilateral):
        for j in range(config.bilateral):
            other = neighbours[:, :, i, j]
            far = ((i - reach) ** 2 + (j - reach) ** 2) / config.bilateral_space**2
            weight = np.exp(-0.5 * (far + ((other - image) / config.bilateral_disparity) ** 2))
            total += weight * other
            weights += weight
    return total / weights
