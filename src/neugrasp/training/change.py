"""Which pixels changed because an object is there: RGB against background, nothing else.

A pixel that did not change says that all the space in front of it is free; one that changed as an object
changes it says that there is matter. One that only became smoothly darker, alike in all colours and away from
every rim, lies in a shadow, and the space in front of it is probably free, too. The rest says nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from neugrasp.views import Image

SAME, OBJECT, SHADOW, UNSURE = 0, 1, 2, -1
OFFSET = 0.06
"""Added before logarithms, so that noise in dark pixels does not count as contrast."""


def change_labels(image: Image, background: Image) -> NDArray[np.int8]:
    """Labels (h, w) of the pixels: SAME, OBJECT, SHADOW or UNSURE, from photos (h, w, 3)."""
    scene = image.astype(np.float32) / 255
    empty = background.astype(np.float32) / 255
    difference = np.abs(scene - empty).sum(-1)
    ratio = np.log(scene + OFFSET) - np.log(empty + OFFSET)
    brightness = ratio.mean(-1)
    chroma = np.abs(ratio - brightness[..., None]).max(-1)
    # A shadow scales a patch by one factor; what lies behind glass or on metal is another picture.
    texture = _local_deviation(brightness, 5)
    object_like = (difference > 0.08) & ((chroma > 0.15) | (texture > 0.08))
    object_like = ndimage.binary_opening(object_like, np.ones((2, 2)))
    # Clear glass shows at its rims; what they enclose belongs to it.
    object_like = ndimage.binary_fill_holes(_closed(object_like, 4))
    nearby = ndimage.maximum_filter(ndimage.uniform_filter(difference, 3), 5)
    labels = np.full(difference.shape, UNSURE, dtype=np.int8)
    # Clear glass before a plain table looks like the table or a shadow: what its rims surround stays open.
    surrounded = _closed(object_like, 12)
    shaded = (chroma < 0.05) & (texture < 0.02) & (brightness < 0.02)
    shaded = ndimage.binary_erosion(shaded) & ~ndimage.binary_dilation(object_like)
    labels[shaded & ~surrounded] = SHADOW
    labels[(nearby < 0.05) & ~surrounded] = SAME
    labels[ndimage.binary_erosion(object_like, iterations=2)] = OBJECT
    return labels


def _closed(mask: NDArray[np.bool_], radius: int) -> NDArray[np.bool_]:
    """The mask with gaps of up to twice the radius bridged: grown by the radius, then shrunk by it."""
    if not mask.any():
        return mask
    grown = ndimage.distance_transform_edt(~np.pad(mask, radius)) <= radius
    shrunk = ndimage.distance_transform_edt(np.pad(grown, 1)) > radius
    inner = slice(radius + 1, -radius - 1)
    return np.asarray(shrunk[inner, inner] | mask, dtype=np.bool_)


def _local_deviation(values: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    mean = ndimage.uniform_filter(values, size)
    square = ndimage.uniform_filter(values**2, size)
    return np.sqrt(np.maximum(square - mean**2, 0))
