"""Do the photos of the empty table agree about it? Laid onto the table plane, they must show the same.

The table is flat, so cameras, intrinsics and the place of the cube are right together exactly where the
backgrounds of all views coincide on it. No network and no correspondences are needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from PIL import Image as Picture
from scipy import ndimage

from neugrasp.doctor.registration import Shift, shift_between
from neugrasp.doctor.table_crop import Mask, TableCrop, grey
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import Image, Views

STEP = 0.0015
"""Metres between the points of the table that are compared; about a pixel of the network."""
COARSE_STEP = 0.003
"""Metres, where many explanations are tried."""
FINE, BROAD = 0.0015, 0.012
"""Metres: standard deviations between which differences of brightness are neither noise nor light."""
SMALLEST_PART = 0.15
"""Share of the table that two views must both see to be compared."""
UNQUESTIONED = 0.9
"""Correlation from which on one shift says it all."""
RELIABLE = 0.6
"""Correlation from which on a measured shift is believed."""
LEAST_CONTRAST = 0.004
"""Standard deviation of the table's texture, of 1, below which nothing can be compared."""


@dataclass(frozen=True)
class TablePicture:
    """A background laid onto the table plane, as a map of the table inside the cube."""

    texture: Array
    """(n, n) brightness without broad light, 0 where not seen."""
    seen: Mask
    """(n, n)"""
    contrast: float
    """Standard deviation of the texture."""


@dataclass(frozen=True)
class Agreement:
    """How well a pair of views agrees about the table."""

    first: int
    second: int
    correlation: float
    """Correlation of the two pictures of the table, -1 to 1."""
    shift: Shift
    """Steps on the table."""

    @property
    def offset(self) -> float:
        """Metres by which the two pictures of the table are apart."""
        return self.shift.length * STEP


def table_picture(
    background: Array, camera: Camera, workspace: Workspace, step: float = STEP
) -> TablePicture:
    """A grey background (h, w) seen from above, by the camera's word (workspace frame)."""
    axis = np.arange(step / 2, workspace.size, step)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    height = np.full_like(x, workspace.table_height)
    pixels, depth = camera.project(np.stack([x, y, height], axis=-1))
    left, top, right, bottom = camera.bounds
    u, v = pixels[..., 0], pixels[..., 1]
    seen = (depth > 0.01) & (u > left + 1) & (u < right - 1) & (v > top + 1) & (v < bottom - 1)
    places = np.stack([np.where(seen, v, 0.0), np.where(seen, u, 0.0)])
    values = ndimage.map_coordinates(background, places, order=1, mode="nearest")
    fine, broad = (_blurred(values, seen, sigma / step) for sigma in (FINE, BROAD))
    texture = np.where(seen, fine - broad, 0.0)
    return TablePicture(texture, seen, float(texture[seen].std()) if seen.any() else 0.0)


def table_pictures(
    crops: Sequence[TableCrop], workspace: Workspace, step: float = STEP
) -> list[TablePicture]:
    """The tables of all crops."""
    return [table_picture(grey(s.background), s.camera, workspace, step) for s in crops]


def coarse_pictures(views: Views) -> list[TablePicture]:
    """The tables of all views from a few pixels of each: quickly, and enough to tell whether they agree."""
    workspace = views.workspace
    pixels = workspace.size / COARSE_STEP
    pictures = []
    for view in views.frames:
        camera = view.camera.moved(inverse(workspace.world_from_workspace))
        crop = np.array(workspace.photo_box(camera)).reshape(2, 2)
        factor = max(1, int((crop[1] - crop[0]).max() / pixels))
        edges = np.array(camera.bounds).reshape(2, 2)
        low = np.ceil(np.maximum(crop[0], edges[0]) + 0.5).astype(int)
        size = (np.minimum(crop[1], edges[1]) + 0.5 - low).astype(int) // factor
        (left, top), (right, bottom) = low.tolist(), (low + size * factor).tolist()
        part = np.ascontiguousarray(view.background[top:bottom, left:right])
        small = Picture.fromarray(part).convert("L").reduce(factor)
        box = (left - 0.5, top - 0.5, right - 0.5, bottom - 0.5)
        reduced = camera.cropped_and_resized(box, small.width, small.height)
        pictures.append(table_picture(np.asarray(small) / 255, reduced, workspace, COARSE_STEP))
    return pictures


def correlation(first: TablePicture, second: TablePicture) -> float | None:
    """Correlation of two pictures of the table where both see it, -1 to 1; None where there is too little
    to compare."""
    both = first.seen & second.seen
    if both.mean() < SMALLEST_PART or min(first.contrast, second.contrast) < LEAST_CONTRAST:
        return None
    a, b = first.texture[both], second.texture[both]
    energy = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / max(energy, 1e-12)


def comparable(pictures: Sequence[TablePicture]) -> list[tuple[int, int]]:
    """The pairs of which both see enough of the same part of the table."""
    pairs = combinations(range(len(pictures)), 2)
    return [(i, j) for i, j in pairs if correlation(pictures[i], pictures[j]) is not None]


def mean_correlation(
    pictures: Sequence[TablePicture], pairs: Sequence[tuple[int, int]] | None = None
) -> float:
    """The mean over pairs of views, by default those that can be compared; 0 for a pair that cannot."""
    values = [correlation(pictures[i], pictures[j]) or 0.0 for i, j in pairs or comparable(pictures)]
    return float(np.mean(values)) if values else 0.0


def agreements(pictures: Sequence[TablePicture]) -> list[Agreement]:
    """Agreements of all pairs of views that can be compared."""
    found = []
    for i, j in comparable(pictures):
        agreement = correlation(pictures[i], pictures[j]) or 0.0
        one, two = _common(pictures[i], pictures[j])
        shift = shift_between(one, two)
        if agreement < UNQUESTIONED and (largest := _largest_shift(one, two)):
            shift = max(shift, largest, key=lambda one: one.length)
        found.append(Agreement(i, j, agreement, shift))
    return found


def _largest_shift(first: Array, second: Array) -> Shift | None:
    """The largest shift of the quarters of two pictures that is to be believed: a wrong scale leaves the
    middle where it is and moves the rest."""
    quarters = [
        shift_between(a, b)
        for halves in zip(np.array_split(first, 2), np.array_split(second, 2), strict=True)
        for a, b in zip(*(np.array_split(half, 2, axis=1) for half in halves), strict=True)
    ]
    return max((s for s in quarters if s.agreement > RELIABLE), key=lambda s: s.length, default=None)


def _common(first: TablePicture, second: TablePicture) -> tuple[Array, Array]:
    """The two textures, cut to the rectangle around what both see."""
    both = first.seen & second.seen
    rows, columns = np.flatnonzero(both.any(axis=1)), np.flatnonzero(both.any(axis=0))
    part = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    return np.where(both, first.texture, 0)[part], np.where(both, second.texture, 0)[part]


def _blurred(values: Array, seen: Mask, sigma: float) -> Array:
    """A Gaussian blur in which what is not seen has no weight."""
    if seen.all():
        return np.asarray(ndimage.gaussian_filter(values, sigma))
    weight = ndimage.gaussian_filter(seen.astype(np.float64), sigma)
    total = ndimage.gaussian_filter(np.where(seen, values, 0.0), sigma)
    return np.asarray(total / np.maximum(weight, 1e-6))


def table_colours(crop: TableCrop, workspace: Workspace) -> Image:
    """(n, n, 3) uint8, for people: the background laid onto the table, x to the right and y upwards."""
    axis = np.arange(STEP / 2, workspace.size, STEP)
    x, y = np.meshgrid(axis, axis[::-1])
    pixels, depth = crop.camera.project(np.stack([x, y, np.full_like(x, workspace.table_height)], axis=-1))
    places = [pixels[..., 1], pixels[..., 0]]
    colours = [ndimage.map_coordinates(crop.background[..., c], places, order=1) for c in range(3)]
    picture = np.stack(colours, axis=-1) * (depth > 0.01)[..., None]
    return np.asarray((picture * 255).round().clip(0, 255).astype(np.uint8))
