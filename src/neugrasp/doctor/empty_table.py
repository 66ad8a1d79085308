"""Is the empty table empty? What stands on it looks different, laid onto the table plane, from every side."""

from __future__ import annotations

from collections.abc import Collection
from itertools import combinations

import numpy as np
from scipy import ndimage

from neugrasp.doctor.findings import Finding, Level, green, not_measured
from neugrasp.doctor.messages import NOT_EMPTY
from neugrasp.doctor.table import STEP, TablePicture, comparable, table_pictures
from neugrasp.doctor.table_crop import Mask, table_crops
from neugrasp.geometry.pose import Array
from neugrasp.observation import Views

ITEM = "empty table"
WINDOW = 0.006
"""Metres: standard deviation of the patch of table that is compared."""
ALIKE, UNLIKE = 0.5, 0.3
"""Correlations of a patch: above which two views agree about it, and below which they do not."""
FAINT = 0.3
"""Texture of a patch, over that of the table, below which in both views nothing can be compared."""
LEAST_AREA = 0.0008
"""Square metres: 3 by 3 cm."""
TRUSTED = 0.6
"""Share of what can be compared about which the views must agree, to call the rest an object."""


def check_empty_table(views: Views, without: Collection[int] = ()) -> Finding:
    """Whether something stands on the table in the backgrounds; those of the views in `without` do not count.

    Where the views disagree about most of the table, it mirrors, and nothing can be told.
    """
    pictures = [
        picture
        for i, picture in enumerate(table_pictures(table_crops(views), views.workspace))
        if i not in without
    ]
    unknown = not_measured(ITEM, "the views have too little of it in common to tell")
    if not comparable(pictures):
        return unknown
    agreed, disputed = _votes(pictures)
    if agreed.sum() < TRUSTED * (agreed | disputed).sum():
        return unknown
    labels, count = ndimage.label(ndimage.binary_opening(disputed, iterations=2))
    areas = ndimage.sum_labels(disputed, labels, np.arange(1, count + 1)) * STEP**2
    if count == 0 or areas.max() < LEAST_AREA:
        return green(ITEM, "nothing stands on it")
    rows, columns = ndimage.find_objects(labels)[int(np.argmax(areas))]
    x, y = ((part.start + part.stop) / 2 * STEP for part in (rows, columns))
    size = 100 * np.sqrt(areas.max())
    text = f"something {size:.0f} cm large at ({x:.2f}, {y:.2f}) of the cube in the backgrounds"
    return Finding(ITEM, Level.YELLOW, text, NOT_EMPTY)


def _votes(pictures: list[TablePicture]) -> tuple[Mask, Mask]:
    """(n, n) each: where most views agree about a patch of the table, and where at least two views do not.

    One view alone may show a reflection; where two views show something else, only the pairs of the others
    are left to agree.
    """
    shape = pictures[0].seen.shape
    alike, unlike = np.zeros(shape, dtype=int), np.zeros(shape, dtype=int)
    for first, second in combinations(pictures, 2):
        known, likeness = _likeness(first, second)
        alike += known & (likeness > ALIKE)
        unlike += known & (likeness < UNLIKE)
    others = np.maximum(sum(picture.seen.astype(int) for picture in pictures) - 2, 0)
    left = others * (others - 1) // 2
    return alike > left, (unlike > left) & (alike <= left)


def _likeness(first: TablePicture, second: TablePicture) -> tuple[Mask, Array]:
    """(n, n) each: where two pictures of the table can be compared, and how well they correlate there."""

    def mean(values: Array) -> Array:
        return np.asarray(ndimage.gaussian_filter(values, WINDOW / STEP))

    both = first.seen & second.seen
    a, b = np.where(both, first.texture, 0), np.where(both, second.texture, 0)
    energy, other = mean(a * a), mean(b * b)
    faint = (FAINT * max(first.contrast, second.contrast)) ** 2
    likeness = mean(a * b) / np.sqrt(energy * other + (0.1 * faint) ** 2)
    return both & (np.maximum(energy, other) > faint), likeness
