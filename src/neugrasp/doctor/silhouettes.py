"""Do the silhouettes agree in space? What changed in one photo must be explained by matter inside the cube.

A pixel that shows an object needs a point on its ray, above the table and inside the cube, that no other view
sees empty. It works on glass and on plain tables. Where nothing can be told, a pixel speaks for nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from neugrasp.change_mask import OBJECT, TABLE, change_labels, unchanged
from neugrasp.doctor.findings import Finding, Limits, green, not_measured
from neugrasp.doctor.messages import SILHOUETTES
from neugrasp.doctor.table_crop import TableCrop
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array
from neugrasp.geometry.workspace import Workspace

ITEM = "silhouettes"
PIXELS = 300
"""Object pixels of each view that are asked."""
LEAST_PIXELS = 50
"""Fewer say nothing."""
DEPTHS = 64
"""Points on the ray of each."""
HEIGHT = 0.2
"""Metres above the table up to which objects are expected."""
SHARE = 0.99
"""Share of the pixels, best first, whose worst one counts: what is left may be noise."""
FAILURE = Limits(2.0, 5.0)
"""Pixels of the network's crop by which silhouettes would have to grow to agree; good captures measure 0
(docs/capture.md)."""


@dataclass(frozen=True)
class Silhouette:
    """What one view says about the space in front of it."""

    camera: Camera
    """Camera of the crop, workspace frame."""
    objects: Array
    """Pixels (n, 2) that show an object."""
    outside: Array
    """(h, w) pixels to the nearest one at which there may be an object; 0 there."""


def check_silhouettes(crops: Sequence[TableCrop], workspace: Workspace, is_alike: bool) -> Finding:
    """Whether the views agree about where objects are.

    Unless images and backgrounds are alike in light, focus and surroundings, more than objects has changed.
    """
    if not is_alike:
        return not_measured(ITEM, "images and backgrounds differ in more than the objects")
    silhouettes = [silhouette_of(crop, workspace) for crop in crops]
    seen = sum(len(s.objects) >= LEAST_PIXELS for s in silhouettes)
    if seen < 2:
        return not_measured(ITEM, "fewer than two views show objects for certain")
    failure = disagreement(silhouettes, workspace)
    level = FAILURE.level(failure)
    text = f"they agree to {failure:.1f} pixels"
    return Finding(ITEM, level, text, SILHOUETTES) if level else green(ITEM, text)


def silhouette_of(crop: TableCrop, workspace: Workspace) -> Silhouette:
    """From the part of a crop that the network reads."""
    box, (height, width) = workspace.photo_box(crop.camera), crop.image.shape[:2]
    left, top = (max(0, int(np.ceil(edge))) for edge in box[:2])
    part = (slice(top, min(height, int(box[3]) + 1)), slice(left, min(width, int(box[2]) + 1)))
    photos = [(photo[part] * 255).round().astype(np.uint8) for photo in (crop.image, crop.background)]
    labels = change_labels(photos[0], photos[1])
    empty = np.zeros((height, width), dtype=bool)
    empty[part] = (labels == TABLE) & unchanged(photos[0], photos[1])
    # Soft shadows are table in one view and something else in the next; specks are noise.
    empty[part] = ~ndimage.binary_opening(~empty[part], np.ones((3, 3)))
    rows, columns = np.nonzero(labels == OBJECT)
    chosen = np.random.default_rng(0).permutation(len(rows))[:PIXELS]
    objects = np.stack([columns[chosen] + left, rows[chosen] + top], axis=-1).astype(np.float64)
    return Silhouette(crop.camera, objects, np.asarray(ndimage.distance_transform_edt(empty)))


def disagreement(silhouettes: Sequence[Silhouette], workspace: Workspace) -> float:
    """Pixels by which the silhouettes would have to grow for `SHARE` of all object pixels to be explained."""
    failures = []
    for one in silhouettes:
        points = _rays(one, workspace)
        cost = np.where(workspace.contains(points), 0.0, np.inf)
        for other in silhouettes:
            if other is not one:
                cost = np.maximum(cost, _outside(other, points))
        failures.append(cost[np.isfinite(cost).any(axis=1)].min(axis=1, initial=np.inf))
    return float(np.quantile(np.concatenate(failures), SHARE))


def _rays(silhouette: Silhouette, workspace: Workspace) -> Array:
    """Points (n, DEPTHS, 3) on the rays of the object pixels, from `HEIGHT` down to the table."""
    eye = silhouette.camera.centre
    way = silhouette.camera.unproject(silhouette.objects, np.ones(len(silhouette.objects))) - eye
    heights = workspace.table_height + np.linspace(HEIGHT, 0, DEPTHS)
    distance = (heights - eye[2]) / np.minimum(way[:, 2:], -1e-6)
    return np.asarray(eye + way[:, None] * distance[..., None])


def _outside(silhouette: Silhouette, points: Array) -> Array:
    """How many pixels points (..., 3) project beside what may be an object; 0 where not seen."""
    pixels, depth = silhouette.camera.project(points)
    height, width = silhouette.outside.shape
    column, row = (np.rint(np.clip(pixels[..., i], -1e6, 1e6)).astype(int) for i in range(2))
    seen = (depth > 0) & (column >= 0) & (row >= 0) & (column < width) & (row < height)
    return np.where(seen, silhouette.outside[np.where(seen, row, 0), np.where(seen, column, 0)], 0.0)
