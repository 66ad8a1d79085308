"""Does each background belong to its image: the same place, and objects in the one only?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from neugrasp.doctor.capture import Capture
from neugrasp.doctor.exchanged import exchanged_views
from neugrasp.doctor.findings import Finding, Level, Limits, green, named, not_measured
from neugrasp.doctor.hypotheses import MOST_VIEWS_PERMUTED, Evidence, best_height
from neugrasp.doctor.messages import BACKGROUND_DIFFERS, EXCHANGED, MIRRORED, SAME_PHOTO, SHIFTED, SWAPPED
from neugrasp.doctor.registration import Shift, shift_between, shift_of_textures, texture
from neugrasp.doctor.table import (
    TablePicture,
    coarse_pictures,
    comparable,
    mean_correlation,
    table_pictures,
)
from neugrasp.doctor.table_crop import GLANCE_SIZE, NETWORK_SIZE, Plane, TableCrop, grey, table_crops
from neugrasp.geometry.pose import Array
from neugrasp.observation import Image, View

SHIFT = Limits(0.3, 1.5)
"""Pixels of the network's crop."""
MATCH = 0.5
"""Correlation from which on two photos show the same table from the same place; chance gives 0.1."""
TEXTURED = 1.5 / 255
"""The strongest tenth of the texture from which on a shift can be told, of 1."""
STRIDE = 2
"""Pixels of the photo of which one is compared."""
SMALL = 160
"""Pixels across of the pictures that a quick look compares."""
OTHERS = 0.6
"""Difference to the background of another view, over that to its own, below which an image is its. Good
captures, on plain tables too, measure 1.6 and more."""
QUANTUM = 0.5
"""Out of 765: below it, differences are rounding."""
MORE_AGREED = 0.05
"""Correlation by which images must agree better about the table than backgrounds to be taken for them."""
FLAT, AGREED_MORE, REST = 0.8, 0.01, 0.5
"""Where some of the views are exchanged: what they must agree by then, how much better, and which share
of the disagreement may be left."""
AGREED = 0.9
"""Mean correlation of backgrounds from which on the table is where it is said to be."""
MORE_EDGES = 1.3
ITEM = "background"


def check_pairs(capture: Capture) -> tuple[Capture, list[Finding]]:
    """Findings on all pairs, and the capture with exchanged or swapped photos put right."""
    if same := check_equal(capture):
        return capture, same
    crops = table_crops(capture.views)
    shifts = [shift_between(grey(crop.image), grey(crop.background)) for crop in crops]
    capture, findings = _placed(capture, crops, shifts)
    still = [i for i, s in enumerate(shifts) if s.agreement < MATCH or SHIFT.level(s.length) == Level.GREEN]
    crops = [crop for crop in table_crops(capture.views) if crop.index in still]
    if not any(finding.level == Level.RED for finding in findings):
        some, text = _exchanged(crops, capture)
        if some:
            findings.append(Finding(ITEM, Level.RED, text, EXCHANGED, named(some, len(capture.views))))
            capture = _turned(capture, some)
    return capture, findings


def check_exchanged_quickly(
    capture: Capture, backgrounds: Sequence[TablePicture]
) -> tuple[Capture, list[Finding]]:
    """What is grave of `check_pairs`, which is asked only where `coarse_pictures` of the images are more like
    an empty table than those of the `backgrounds` are, or have less to see on a plain one."""
    frames = tuple(replace(view, background=view.image) for view in capture.views.frames)
    images = coarse_pictures(replace(capture.views, frames=frames))
    is_edgy = any(b.contrast > MORE_EDGES * i.contrast for b, i in zip(backgrounds, images, strict=True))
    if not exchanged_views(backgrounds, images) and (comparable(backgrounds) or not is_edgy):
        return capture, []
    capture, found = check_pairs(capture)
    return capture, [finding for finding in found if finding.level == Level.RED]


def _turned(capture: Capture, some: tuple[int, ...]) -> Capture:
    views = [
        replace(view, image=view.background, background=view.image) if i in some else view
        for i, view in enumerate(capture.views.frames)
    ]
    return replace(capture.with_views(views), exchanged=some)


def check_pairs_quickly(capture: Capture, crops: Sequence[TableCrop]) -> tuple[Capture, list[Finding]]:
    """As `check_pairs`, which is asked only where a look at small crops, of `GLANCE_SIZE`, leaves doubts."""
    if same := check_equal(capture):
        return capture, same
    views = capture.views.frames
    if not _owners(views, max(STRIDE, *(max(view.image.shape) // SMALL for view in views))):
        empty = [texture(grey(crop.background)) for crop in crops]
        textured = [(crop, table) for crop, table in zip(crops, empty, strict=True) if _is_rich(table)]
        shifts = (shift_of_textures(texture(grey(crop.image)), table) for crop, table in textured)
        longer = NETWORK_SIZE / GLANCE_SIZE
        if all(s.agreement >= MATCH and SHIFT.level(longer * s.length) < Level.RED for s in shifts):
            return capture, []
    return check_pairs(capture)


def check_equal(capture: Capture) -> list[Finding]:
    """Red where an image is its own background; nothing to say otherwise."""
    views = capture.views.frames
    same = [i for i, view in enumerate(views) if np.array_equal(view.image, view.background)]
    text = "image and background are equal"
    return [Finding(ITEM, Level.RED, text, SAME_PHOTO, named(same, len(views)))] if same else []


def _exchanged(crops: list[TableCrop], capture: Capture) -> tuple[tuple[int, ...], str]:
    """The views whose image and background are exchanged, and what speaks for it; nothing if nothing does.

    The empty table is flat, so its photos agree when laid onto the table plane, and those with objects less;
    on a plain table, objects are what has edges.
    """
    everyone = tuple(crop.index for crop in crops)
    sides = [crops, [replace(crop, background=crop.image) for crop in crops]]
    tables = [table_pictures(side, capture.views.workspace) for side in sides]
    if pairs := comparable(tables[0]):
        as_is, full = (mean_correlation(pictures, pairs) for pictures in tables)
        empty = as_is
        agreed, some = max((_mixed(tables, part, pairs), part) for part in _parts(len(crops)))
        if agreed > max(FLAT, empty + AGREED_MORE, full + AGREED_MORE) and 1 - agreed < REST * (1 - empty):
            text = f"the photos of the table agree by {agreed:.2f} with image and background exchanged, else "
            return tuple(everyone[i] for i in some), f"{text}by {empty:.2f}"
        # Where the cube stands too high or too low, tops of objects may agree by chance: each at its best.
        if full > empty + MORE_AGREED:
            empty, full = (best_height(Evidence(capture, side, pairs, None)).agreement for side in sides)
        if as_is > AGREED and (some := exchanged_views(*tables)):
            text = f"where image and background differ, the images of {len(some)} views show the empty table"
            return tuple(everyone[i] for i in some), text
        if max(empty, full) > MATCH:
            text = f"the images agree about the table by {full:.2f}, the backgrounds by {empty:.2f}"
            return (everyone, text) if full > empty + MORE_AGREED else ((), "")
    edges = [(_edges(crop.image, crop), _edges(crop.background, crop)) for crop in crops]
    some = tuple(i for i, (image, background) in enumerate(edges) if background > MORE_EDGES * image)
    if some and all(
        i in some or image > MORE_EDGES * background for i, (image, background) in enumerate(edges)
    ):
        which = "every" if len(some) == len(crops) else "the"
        return tuple(
            everyone[i] for i in some
        ), f"{which} background has more edges in the cube than its image"
    return (), ""


def _parts(count: int) -> list[tuple[int, ...]]:
    """Some of so many views, but not all: every choice of a few, or each alone."""
    sizes = range(1, count if count <= MOST_VIEWS_PERMUTED else min(count, 2))
    return [part for size in sizes for part in combinations(range(count), size)] or [()]


def _mixed(tables: list[list[TablePicture]], part: tuple[int, ...], pairs: list[tuple[int, int]]) -> float:
    """How well the tables agree with images in place of backgrounds for a part of the views."""
    return mean_correlation([tables[i in part][i] for i in range(len(tables[0]))], pairs)


def _edges(picture: Plane, crop: TableCrop) -> float:
    inside = crop.inside if crop.inside.any() else np.ones_like(crop.inside)
    return float(np.sqrt((texture(grey(picture))[inside] ** 2).mean()))


def _placed(capture: Capture, crops: list[TableCrop], shifts: list[Shift]) -> tuple[Capture, list[Finding]]:
    """The shift between image and background of every view; where there is none to be found, whose it is."""
    textured = [_is_rich(texture(grey(crop.background))) for crop in crops]
    owner = _owners(capture.views.frames)
    lost = [i for i, s in enumerate(shifts) if i in owner or (textured[i] and s.agreement < MATCH)]
    known = [i for i, shift in enumerate(shifts) if shift.agreement >= MATCH and i not in lost]
    findings: list[Finding] = []
    if lost:
        capture, findings = _foreign(capture, crops, lost, owner)
    if known:
        findings.append(_shifted(crops, shifts, known))
    elif not lost:
        findings.append(not_measured(ITEM, "too little texture on the table to tell a shift"))
    return capture, findings


def _is_rich(table: Array) -> bool:
    """Whether the texture of a table is enough to tell a shift."""
    return bool(np.percentile(np.abs(table), 90) > TEXTURED)


def _shifted(crops: list[TableCrop], shifts: list[Shift], known: list[int]) -> Finding:
    """The largest shift that could be measured."""
    level = max(SHIFT.level(shifts[i].length) for i in known)
    worst = max(known, key=lambda i: shifts[i].length)
    shift, scale = shifts[worst], crops[worst].photo_pixels
    size = f"{shift.length * scale:.2f} pixels of the photo"
    if level == Level.GREEN:
        return green(ITEM, f"shifted by at most {size}")
    text = f"shifted by ({shift.x * scale:+.2f}, {shift.y * scale:+.2f}), {size}"
    bad = [i for i in known if SHIFT.level(shifts[i].length) == level]
    return Finding(ITEM, level, text, SHIFTED, named(bad, len(crops)))


def _foreign(
    capture: Capture, crops: list[TableCrop], lost: list[int], owner: dict[int, int]
) -> tuple[Capture, list[Finding]]:
    """Views whose background is not theirs: whose it is, or whether one of the two is mirrored."""
    views = list(capture.views.frames)
    swapped = tuple(i for i in lost if i in owner)
    findings = []
    if swapped:
        text = ", ".join(f"image {i} fits background {owner[i]}" for i in swapped)
        findings.append(Finding(ITEM, Level.RED, text, SWAPPED, swapped))
        order = [owner.get(i, i) for i in range(len(views))]
        if sorted(order) == list(range(len(views))):
            capture = _reordered(capture, order)
    rest = tuple(i for i in lost if i not in swapped)
    turned = tuple(i for i in rest if _is_turned(crops[i], views[i]))
    if turned:
        text = "the image fits its background when one of them is turned over"
        findings.append(Finding(ITEM, Level.RED, text, MIRRORED, turned))
    if strange := tuple(i for i in rest if i not in turned):
        text = "no shift brings the table's texture to cover"
        findings.append(Finding(ITEM, Level.RED, text, BACKGROUND_DIFFERS, strange))
    return capture, findings


def _owners(views: Sequence[View], stride: int = STRIDE) -> dict[int, int]:
    """For each view whose image is far more like the background of another view than its own, that view."""
    images = [_thinned(view.image, stride) for view in views]
    backgrounds = [_thinned(view.background, stride) for view in views]
    unlike = np.array([[_unlikeness(image, other) for other in backgrounds] for image in images])
    sizes = [(view.image.shape, view.background.shape) for view in views]
    unlike[[[image != other for _, other in sizes] for image, _ in sizes]] = np.inf
    best, least = unlike.argmin(axis=1), unlike.min(axis=1)
    found = (least + QUANTUM < OTHERS * unlike.diagonal()) & (least <= 2 * np.median(least) + QUANTUM)
    found &= np.bincount(best)[best] == 1  # No background belongs to two views.
    if found.any() and sorted(best) == list(range(len(views))):
        found = best != np.arange(len(views))  # Each has one, so those that are less clear are settled, too.
    return {int(i): int(best[i]) for i in np.flatnonzero(found)}


def _thinned(photo: Image, stride: int) -> NDArray[np.int16]:
    """(3, h, w): one of so many pixels each way; a channel lies together, which is quick to add."""
    return np.ascontiguousarray(photo[::stride, ::stride].transpose(2, 0, 1), dtype=np.int16)


def _unlikeness(image: NDArray[np.int16], background: NDArray[np.int16]) -> float:
    """How much the more alike half of an image differs from a background; objects cover the other half."""
    if image.shape != background.shape:
        return np.inf
    return float(np.quantile(np.abs(image - background).sum(axis=0, dtype=np.int16), 0.25))


def _is_turned(crop: TableCrop, view: View) -> bool:
    """Whether the image fits its background when it is mirrored or turned upside down."""
    turned = [view.image[:, ::-1], view.image[::-1], view.image[::-1, ::-1]]
    cuts = [_cut(np.ascontiguousarray(picture), crop) for picture in turned]
    return any(shift_between(grey(cut), grey(crop.background)).agreement >= MATCH for cut in cuts)


def _cut(photo: np.ndarray, crop: TableCrop) -> Plane:
    """The part of another photo of the same size that a crop shows."""
    height, width = crop.background.shape[:2]
    left, top, right, bottom = (edge + 0.5 for edge in crop.box)
    picture = Picture.fromarray(photo).resize(
        (width, height), Picture.Resampling.BOX, (left, top, right, bottom)
    )
    return np.asarray(picture, dtype=np.float32) / 255


def _reordered(capture: Capture, order: Sequence[int]) -> Capture:
    """The capture whose image i has background `order[i]`. The photos of the empty table tell which of the
    two was mixed up: they agree where each is at the pose of its camera."""
    views = capture.views.frames
    backgrounds = capture.with_views(
        [replace(view, background=views[j].background) for view, j in zip(views, order, strict=True)]
    )
    if _agreement(backgrounds) >= _agreement(capture):
        return replace(backgrounds, backgrounds=tuple(capture.backgrounds[j] for j in order))
    images = capture.with_views(
        [replace(view, image=views[order.index(i)].image) for i, view in enumerate(views)]
    )
    return replace(images, images=tuple(capture.images[order.index(i)] for i in range(len(views))))


def _agreement(capture: Capture) -> float:
    return mean_correlation(coarse_pictures(capture.views))
