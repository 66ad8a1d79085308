"""Displayed values (sRGB) and the light that they stand for, both from 0 to 1 (IEC 61966-2-1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from neugrasp.geometry.pose import Array


def linear(displayed: ArrayLike) -> Array:
    """The light (...) of displayed values (...)."""
    values = np.asarray(displayed, dtype=np.float64)
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def displayed(light: ArrayLike) -> Array:
    """The reverse of `linear`."""
    values = np.asarray(light, dtype=np.float64)
    return np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)
