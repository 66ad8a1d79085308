"""Do photos of the empty table, laid onto its plane, agree with each other where the cameras are said to "
"be?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import ndimage

from neugrasp.geometry.lens import Lens
from neugrasp.geometry.pose import Array, apply, inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.importers.resampling import is_inside
from neugrasp.observation import Image

STEP = 0.004
"""Metres between the points of the table that are looked at."""
COARSE = 0.02
"""Metres: brightness that changes over more than that is light, not pattern."""
FAINTEST = 1.5
"""Grey levels of pattern, below which a table has none."""
USUAL_DISTANCE = 0.5
"""Metres between camera and table."""
SHARED = 0.1
"""Share of the points that two photos must both show to be compared."""


@dataclass(frozen=True)
class TablePhoto:
    """A photo of the empty table, smoothed to what the points can show."""

    grey: Array
    """(h, w)"""
    lens: Lens

    @classmethod
    def of(cls, photo: Image, lens: Lens) -> TablePhoto:
        """A photo (h, w, 3), as the lens took it, from some half a metre."""
        sigma = 0.5 * STEP * lens.intrinsics[0, 0] / USUAL_DISTANCE
        return cls(ndimage.gaussian_filter(photo.mean(axis=-1, dtype=np.float32), sigma), lens)

    def pattern(self, world_from_camera: Array, points: Array) -> Array:
        """(n, n) what the photo shows at points (n, n, 3) of the world, without slow changes; NaN where "
        "nothing."""
        seen = apply(inverse(world_from_camera), points)
        with np.errstate(divide="ignore", invalid="ignore"):
            ideal = (seen @ self.lens.intrinsics.T)[..., :2] / seen[..., 2:]
            places = self.lens.distorted(ideal)
        is_seen = is_inside(self.lens, places) & (seen[..., 2] > 0)
        rows_and_columns = [np.where(is_seen, places[..., axis], 0) for axis in (1, 0)]
        grey = ndimage.map_coordinates(self.grey, rows_and_columns, order=1, mode="nearest")
        weight = ndimage.gaussian_filter(is_seen.astype(float), COARSE / STEP)
        slow = ndimage.gaussian_filter(np.where(is_seen, grey, 0.0), COARSE / STEP) / np.maximum(weight, 1e-6)
        return np.where(is_seen, grey - slow, np.nan)


def table_points(workspace: Workspace) -> Array:
    """Points (n, n, 3) of the table in and around the cube, in the world."""
    edge = np.arange(-0.25 * workspace.size, 1.25 * workspace.size, STEP)
    x, y = np.meshgrid(edge, edge)
    return workspace.to_world(np.stack([x, y, np.full_like(x, workspace.table_height)], axis=-1))


def agreement(photos: Sequence[TablePhoto], poses: Sequence[Array], points: Array) -> float | None:
    """Mean correlation of all pairs of photos about the table, -1 to 1; None where nothing can be "
    "compared."""
    patterns = [photo.pattern(pose, points) for photo, pose in zip(photos, poses, strict=True)]
    found = []
    for one, other in combinations(patterns, 2):
        both = np.isfinite(one) & np.isfinite(other)
        if both.mean() < SHARED:
            continue
        a, b = one[both] - one[both].mean(), other[both] - other[both].mean()
        if min(a.std(), b.std()) < FAINTEST:
            continue
        found.append(float((a * b).mean() / (a.std() * b.std())))
    return float(np.mean(found)) if found else None
