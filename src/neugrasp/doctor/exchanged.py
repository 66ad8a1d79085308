"""Which of a view's two photos shows objects: where the two differ, the empty table is like the tables of the
other views, and the other photo is not. A small object tells as much as a large one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from neugrasp.doctor.table import TablePicture, comparable
from neugrasp.doctor.table_crop import Mask

CHANGED, LEAST_CHANGE = 6.0, 0.01
"""Deviations from the usual difference of two photos, and brightness of 1, from which on a point changed."""
LEAST_POINTS = 12
"""Of the table, of a part that changed."""
CLEARLY, AT_ALL = 0.2, 0.05
"""Correlation by which the image must be more like the other tables there than the background is; less where
all views say so."""
DISSENT = 0.1
"""Share of what changed that may say otherwise: where something stood on the empty table, much of it does."""


def exchanged_views(backgrounds: Sequence[TablePicture], images: Sequence[TablePicture]) -> tuple[int, ...]:
    """The views whose image looks like the empty table where their background does not; of pictures of the
    table as all backgrounds, and as all images, have it."""
    views = range(len(backgrounds))
    pairs = comparable(backgrounds)
    if pairs and all(_is_exchanged(view, pairs, (backgrounds, images), AT_ALL) for view in views):
        return tuple(views)
    return tuple(view for view in views if _is_exchanged(view, pairs, (backgrounds, images), CLEARLY))


def _is_exchanged(
    view: int,
    pairs: Sequence[tuple[int, int]],
    tables: tuple[Sequence[TablePicture], Sequence[TablePicture]],
    least: float,
) -> bool:
    """Whether a view's image is more like empty tables, by `least`, than its background is: like the other
    backgrounds, or where all are exchanged, like the other images."""
    backgrounds, images = tables
    others = images if least == AT_ALL else backgrounds
    votes = {True: 0, False: 0}
    for part in _changed_parts(backgrounds[view], images[view]):
        likeness = [
            [
                _likeness(backgrounds[view], backgrounds[other], part),
                _likeness(images[view], others[other], part),
            ]
            for pair in pairs
            if view in pair and (part & others[(other := sum(pair) - view)].seen).sum() >= LEAST_POINTS
        ]
        if likeness:
            own, theirs = np.mean(likeness, axis=0)
            votes[bool(theirs > own + least)] += int(part.sum())
    return bool(votes[True]) and votes[False] <= DISSENT * sum(votes.values())


def _changed_parts(background: TablePicture, image: TablePicture) -> list[Mask]:
    """(n, n) each: where the two photos differ by more than their noise, what nearly touches in one."""
    changed = _changed(background, image)
    labels, count = ndimage.label(ndimage.binary_dilation(changed, iterations=2))
    parts = [changed & (labels == number) for number in range(1, count + 1)]
    return [part for part in parts if part.sum() >= LEAST_POINTS]


def _changed(background: TablePicture, image: TablePicture) -> Mask:
    """(n, n) where the two photos differ by more than their noise."""
    difference = np.abs(background.texture - image.texture)
    seen = background.seen & image.seen
    usual = 1.4826 * float(np.median(difference[seen])) if seen.any() else 0.0
    return np.asarray(seen & (difference > max(CHANGED * usual, LEAST_CHANGE)))


def _likeness(one: TablePicture, other: TablePicture, part: Mask) -> float:
    """Correlation of two tables in a part of both."""
    both = part & one.seen & other.seen
    a, b = one.texture[both], other.texture[both]
    energy = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / max(energy, 1e-12)
