"""Which pixels show an object and which the table: RGB against background, nothing else.

A pixel that shows the table, lit or shaded, says that all the space in front of it is free; one that shows an
object says that there is matter. A shadow ends softly and an object ends at an edge, so the picture of the
*change* is flooded from what certainly did not change and from what certainly is another thing, and the two
floods meet at its edges (a watershed with markers). Where clear glass may hide, nothing is said.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.segmentation import watershed

from neugrasp.observation import Image

TABLE, OBJECT, UNSURE = 0, 1, -1
OFFSET = 0.06
"""Added before logarithms, so that noise in dark pixels does not count as contrast."""
UNCHANGED = 0.05
"""Summed over RGB in [0, 1], mean of 3 x 3: below it, nothing happened here."""
CHROMA = 0.15
"""Change of one colour's logarithm against the mean of the three: shadows and lamps stay below."""
REACH = 20
"""Pixels: gaps up to twice as wide between weak signs of an object may be clear glass on a plain table."""


@dataclass(frozen=True)
class _Change:
    """How a photo differs from its background, by pixel."""

    difference: NDArray[np.float32]
    """(h, w) summed over RGB."""
    ratio: NDArray[np.float32]
    """(h, w, 3) difference of the logarithms."""
    chroma: NDArray[np.float32]
    """(h, w) how far the three colours changed apart."""
    texture: NDArray[np.float32]
    """(h, w) deviation of the brightness ratio in 5 x 5: a shadow scales a patch by one factor."""

    @classmethod
    def between(cls, image: Image, background: Image) -> _Change:
        scene, empty = image.astype(np.float32) / 255, background.astype(np.float32) / 255
        ratio = np.log(scene + OFFSET) - np.log(empty + OFFSET)
        brightness = _over_colours(np.add, ratio) / 3
        chroma = _over_colours(np.maximum, np.abs(ratio - brightness[..., None]))
        difference = _over_colours(np.add, np.abs(scene - empty))
        return cls(difference, ratio, chroma, _local_deviation(brightness, 5))

    def unlike_shadow(self, difference: float, texture: float, closing: int) -> NDArray[np.bool_]:
        """What changes as objects do, gaps of twice `closing` pixels bridged and what rims enclose filled."""
        changed = (self.difference > difference) & ((self.chroma > CHROMA) | (self.texture > texture))
        changed = ndimage.binary_opening(changed, np.ones((2, 2)))
        filled: NDArray[np.bool_] = ndimage.binary_fill_holes(_closed(changed, closing))
        return filled

    def edges(self) -> NDArray[np.float32]:
        """(h, w) steepness of the ratio: the ridges at which the floods meet."""
        smooth = ndimage.gaussian_filter(self.ratio, (0.7, 0.7, 0))
        return _over_colours(np.maximum, np.hypot(ndimage.sobel(smooth, 0), ndimage.sobel(smooth, 1)))


def change_labels(image: Image, background: Image) -> NDArray[np.int8]:
    """Labels (h, w) of the pixels: TABLE, OBJECT or UNSURE, from photos (h, w, 3)."""
    change = _Change.between(image, background)
    strong = change.unlike_shadow(difference=0.08, texture=0.08, closing=4)
    weak = change.unlike_shadow(difference=0.03, texture=0.03, closing=4)
    unchanged = ndimage.uniform_filter(change.difference, 3) < UNCHANGED
    markers = np.zeros(strong.shape, dtype=np.int32)
    markers[unchanged & ~_closed(weak, REACH)] = 1
    markers[ndimage.binary_erosion(strong, iterations=2)] = 2
    flooded = watershed(change.edges(), markers)
    # The halo of the texture's window reaches 2 pixels beyond an object; deeper signs are worth a doubt.
    doubtful = ndimage.binary_erosion(weak, iterations=3) & ~strong
    labels = np.full(strong.shape, UNSURE, dtype=np.int8)
    labels[(flooded == 1) & ~doubtful] = TABLE
    labels[ndimage.binary_erosion(flooded == 2, border_value=1)] = OBJECT
    return labels


def unchanged(image: Image, background: Image) -> NDArray[np.bool_]:
    """(h, w): where photos (h, w, 3) show the same in the same light: not even a soft shadow lies there."""
    difference = _over_colours(np.add, np.abs(image.astype(np.float32) - background.astype(np.float32)))
    return np.asarray(ndimage.uniform_filter(difference / 255, 3) < UNCHANGED)


def _closed(mask: NDArray[np.bool_], radius: int) -> NDArray[np.bool_]:
    """The mask with gaps of up to twice the radius bridged: grown by the radius, then shrunk by it."""
    if not mask.any():
        return mask
    grown = ndimage.distance_transform_edt(~np.pad(mask, radius)) <= radius
    shrunk = ndimage.distance_transform_edt(np.pad(grown, 1)) > radius
    inner = slice(radius + 1, -radius - 1)
    return np.asarray(shrunk[inner, inner] | mask, dtype=np.bool_)


def _over_colours(combine: np.ufunc, values: NDArray[np.float32]) -> NDArray[np.float32]:
    """`combine.reduce` over the last axis (h, w, 3), not pixel by pixel, which takes twenty times as long."""
    combined: NDArray[np.float32] = combine(combine(values[..., 0], values[..., 1]), values[..., 2])
    return combined


def _local_deviation(values: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    mean = ndimage.uniform_filter(values, size)
    square = ndimage.uniform_filter(values**2, size)
    return np.sqrt(np.maximum(square - mean**2, 0))
