"""How the light changed between two photos: exposure, white balance, and from one side to the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from neugrasp.doctor.registration import tukey
from neugrasp.doctor.table_crop import Mask, Plane, TableCrop
from neugrasp.geometry.pose import Array
from neugrasp.srgb import displayed, linear

DARKEST, BRIGHTEST = 0.06, 0.97
"""Displayed values between which a ratio of light is meaningful."""
STRIDE = 3
SMOOTHING = 1.5
"""Standard deviation, pixels, of the blur that takes the noise away."""
ROUNDS, SETTLED = 15, 1e-5
"""Most rounds of the fit, and the stops by which a round moves a plane that needs no further one."""
RIDGE = 1e-9
"""Keeps a fit to places on one line solvable."""
DIFFERENT = 0.06
"""Displayed difference, of 1, that an eye sees as something else."""


TINTED = 1.0
"""Stops by which a shadow may darken one colour more than another: the lamps of a room differ in colour."""
DEEPEST = 2.5
"""Stops that a shadow darkens at the most: other lamps, and walls, light a room, too."""
UNEVEN = 0.25
"""Stops by which the darkening may vary within a few pixels: a shadow keeps the pattern that it lies on."""
PATCH = 7
"""Pixels, edge."""
SHADE_FLOOR = 0.01
"""Out of 1, linear; added before logarithms, so that noise in black pixels has no colour."""


@dataclass(frozen=True)
class Drift:
    """Light of the image over light of the background where both show the same, in stops (EV)."""

    exposure: float
    """Exposure of the middle of the crop."""
    white_balance: float
    """Largest difference between two colour channels."""
    slope: float
    """Largest difference between two corners: a lamp or the daylight moved."""
    compared: float
    """Share of the crop that shows the same in both; what is small says nothing."""
    plane: Array
    """(3, 3): for each channel the stops at the middle and per half width and half height."""

    def corrected(self, background: Plane) -> Plane:
        """The background as it would look in the light of the image."""
        stops = _basis(background.shape[:2]) @ self.plane.T
        light = np.clip(linear(background) * 2.0**stops, 0, 1)
        return np.asarray(displayed(light), dtype=np.float32)


def drift_of(crop: TableCrop) -> Drift:
    """The change of light between the photo and its background; objects and their shadows do not count."""
    image, background = (_smooth(p)[::STRIDE, ::STRIDE] for p in (crop.image, crop.background))
    basis = _basis(crop.image.shape[:2])[::STRIDE, ::STRIDE].reshape(-1, 3)
    low, high = np.minimum(image, background), np.maximum(image, background)
    usable = (over_channels(np.minimum, low) > DARKEST) & (over_channels(np.maximum, high) < BRIGHTEST)
    usable = usable.ravel()
    if usable.sum() < 50:
        return Drift(0.0, 0.0, 0.0, 0.0, np.zeros((3, 3)))
    stops = np.log2(linear(image) / linear(background)).reshape(-1, 3)[usable]
    basis = basis[usable]
    _, weight = _robust_plane(basis, stops.mean(axis=-1))
    root = np.sqrt(weight)[:, None]
    plane = np.linalg.lstsq(basis * root, stops * root, rcond=None)[0].T
    mean = plane.mean(axis=0)
    return Drift(
        exposure=float(mean[0]),
        white_balance=float(np.ptp(plane[:, 0])),
        slope=float(2 * np.abs(mean[1:]).sum()),
        compared=float((weight > 0.1).sum() / len(usable)),
        plane=plane,
    )


def different(crop: TableCrop, drift: Drift) -> Mask:
    """(h, w): where the photo shows something else than the background, the change of light taken away."""
    # A blur is linear, so that of the difference is enough.
    difference = np.abs(_smooth(crop.image - drift.corrected(crop.background)))
    return np.asarray(over_channels(np.maximum, difference) > DIFFERENT)


def shaded(crop: TableCrop, drift: Drift) -> Mask:
    """(h, w): where the photo shows what the background shows, in less light: a shadow, or nothing at all."""
    now, before = linear(_smooth(crop.image)), linear(_smooth(drift.corrected(crop.background)))
    stops = np.log2((now + SHADE_FLOOR) / (before + SHADE_FLOOR))
    tint = over_channels(np.maximum, stops) - over_channels(np.minimum, stops)
    mean = stops.mean(axis=-1)
    local = ndimage.uniform_filter(mean, PATCH)
    varies = np.sqrt(np.maximum(ndimage.uniform_filter(mean**2, PATCH) - local**2, 0))
    return np.asarray((mean < 0) & (mean > -DEEPEST) & (tint < TINTED) & (varies < UNEVEN))


def over_channels(least_or_most: np.ufunc, picture: Array | Plane) -> Array:
    """(h, w) of a colour picture (h, w, 3); numpy itself is slow along an axis of three."""
    first, second, third = (picture[..., c] for c in range(3))
    return np.asarray(least_or_most(least_or_most(first, second), third))


def _smooth(picture: Plane) -> Array:
    return np.asarray(ndimage.gaussian_filter(picture.astype(np.float64), (SMOOTHING, SMOOTHING, 0)))


def _basis(shape: tuple[int, ...]) -> Array:
    """(h, w, 3): 1 and the place in the picture, from -1 to 1."""
    v, u = np.meshgrid(np.linspace(-1, 1, shape[0]), np.linspace(-1, 1, shape[1]), indexing="ij")
    return np.stack([np.ones_like(u), u, v], axis=-1)


def _robust_plane(basis: Array, values: Array) -> tuple[Array, Array]:
    """The plane through the bulk of the values and the weights of all."""
    plane = np.array([_mode(values), 0.0, 0.0])
    weight = np.ones(len(values))
    for _ in range(ROUNDS):
        weight, _ = tukey(values - basis @ plane, floor=0.01)
        weighted = basis * weight[:, None]
        before, plane = plane, np.linalg.solve(weighted.T @ basis + RIDGE * np.eye(3), weighted.T @ values)
        if np.abs(plane - before).max() < SETTLED:
            break
    return plane, weight


def _mode(values: Array) -> float:
    """Where values are densest: the middle of the shortest half, halved again and again."""
    ordered = np.sort(values)
    while len(ordered) > 3:
        half = len(ordered) // 2
        start = int(np.argmin(ordered[half:] - ordered[: len(ordered) - half]))
        ordered = ordered[start : start + half]
    return float(ordered.mean())
