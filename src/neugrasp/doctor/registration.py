"""By how much one photo is shifted against another: phase correlation, then robust least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from neugrasp.geometry.pose import Array

FINE, BROAD = 1.0, 5.0
"""Standard deviations, pixels, of the blurs between which contrast counts: noise is finer, light broader."""
STEPS = 12
FLOOR = 0.1 / 255
"""Smallest spread of residuals: the noise of rounding to 8 bits, blurred."""
UNQUESTIONED, NEAR = 0.95, 1.0
"""Agreement from which on, and pixels up to which, no other shift is looked for."""
TUKEY = 4.685
"""Residuals beyond so many standard deviations do not count."""


@dataclass(frozen=True)
class Shift:
    """Where things of the second picture lie in the first: first(p + (x, y)) = second(p)."""

    x: float
    y: float
    uncertainty: float
    """Standard deviation, pixels; large where there is no texture to compare."""
    agreement: float
    """Correlation, at most 1, of the two pictures where they show the same."""

    @property
    def length(self) -> float:
        """Pixels."""
        return float(np.hypot(self.x, self.y))


def shift_between(first: Array, second: Array, largest: float = 0.2) -> Shift:
    """The shift of two grey pictures (h, w) of the same size, up to `largest` times their smaller side.

    Brightness and contrast may differ; what covers less than half of the picture may differ, too.
    """
    return shift_of_textures(texture(first), texture(second), largest)


def shift_of_textures(first: Array, second: Array, largest: float = 0.2) -> Shift:
    """The same of two pictures as `texture` gives them."""
    here = _refined(first, second, (0.0, 0.0))
    # On a regular pattern there are others, a period away; the nearest one is meant.
    if here.agreement >= UNQUESTIONED and here.length < NEAR:
        return here
    start = _phase_correlation(first, second, largest)
    return max(here, _refined(first, second, start), key=lambda shift: shift.agreement)


def texture(picture: Array) -> Array:
    """What is neither noise nor light: a picture less its broad blur."""
    return ndimage.gaussian_filter(picture, FINE) - ndimage.gaussian_filter(picture, BROAD)


def _phase_correlation(first: Array, second: Array, largest: float) -> tuple[float, float]:
    """The whole-pixel shift (x, y) at which the phases of the two pictures agree best."""
    height, width = first.shape
    window = np.outer(np.hanning(height), np.hanning(width))
    spectra = [np.fft.fft2(picture * window) for picture in (first, second)]
    cross = spectra[0] * np.conj(spectra[1])
    surface = np.fft.ifft2(cross / np.maximum(np.abs(cross), 1e-9)).real
    reach = max(1, int(largest * min(height, width)))
    rows, columns = np.fft.fftfreq(height, 1 / height), np.fft.fftfreq(width, 1 / width)
    near = (np.abs(rows)[:, None] <= reach) & (np.abs(columns) <= reach)
    row, column = np.unravel_index(np.argmax(np.where(near, surface, -np.inf)), surface.shape)
    return float(columns[column]), float(rows[row])


def _refined(first: Array, second: Array, start: tuple[float, float]) -> Shift:
    """Gauss-Newton on shift and gain with Tukey's weights."""
    (x, y), gain = start, 1.0
    border = int(np.ceil(max(abs(x), abs(y)))) + 3
    core = (slice(border, -border), slice(border, -border))
    target = second[core]
    if min(target.shape) < 8:
        return Shift(x, y, np.inf, -np.inf)
    for _ in range(STEPS):
        moved = _moved(_moved(first, y).T, x).T
        slope_y, slope_x = np.gradient(moved)
        design = np.stack([part[core].ravel() for part in (slope_x, slope_y, moved)])
        design[:2] *= gain
        residual = (target - gain * moved[core]).ravel()
        weight, spread = tukey(residual)
        weighted = design * weight
        normal = weighted @ design.T + 1e-9 * np.eye(3)
        step = np.linalg.solve(normal, weighted @ residual)
        x, y = x + np.clip(step[0], -1, 1), y + np.clip(step[1], -1, 1)
        gain = gain + step[2]
        if np.hypot(step[0], step[1]) < 1e-3:
            break
    uncertainty = spread * float(np.sqrt(np.linalg.inv(normal)[:2, :2].trace()))
    a, b = moved[core].ravel(), target.ravel()
    energy = float(np.sqrt((weight * a * a).sum() * (weight * b * b).sum()))
    agreement = float((weight * a * b).sum()) / max(energy, 1e-12)
    return Shift(float(x), float(y), uncertainty, float(agreement))


def _moved(picture: Array, down: float) -> Array:
    """The picture read so many pixels further down, between its rows; beyond its edge the last row stands."""
    whole = int(np.floor(down))
    rows = np.arange(len(picture)) + whole
    upper, lower = (np.take(picture, rows + i, axis=0, mode="clip") for i in range(2))
    return np.asarray(upper + (down - whole) * (lower - upper))


def tukey(residual: Array, floor: float = FLOOR) -> tuple[Array, float]:
    """Weights in [0, 1] and the standard deviation of the bulk, never below `floor`."""
    spread = max(1.4826 * _median(np.abs(residual - _median(residual))), floor)
    scaled = residual / (TUKEY * spread)
    return np.where(np.abs(scaled) < 1, (1 - scaled**2) ** 2, 0.0), spread


def _median(values: Array) -> float:
    """As numpy's, which looks at the values once more for those that are no numbers."""
    middle = len(values) // 2
    ordered = np.partition(values, [(len(values) - 1) // 2, middle])
    return float(ordered[(len(values) - 1) // 2] + ordered[middle]) / 2
