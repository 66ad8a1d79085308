"""Light, focus and what else differs between image and background."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy import ndimage

from neugrasp.doctor.findings import Finding, Level, Limits, Problem, green, judged, not_measured
from neugrasp.doctor.light import Drift, different, drift_of, over_channels, shaded
from neugrasp.doctor.messages import (
    BLURRED,
    CHANGED_OUTSIDE,
    DARK,
    EXPOSURE,
    LIGHT_MOVED,
    NOTHING_THERE,
    SATURATED,
    WHITE_BALANCE,
)
from neugrasp.doctor.table_crop import Mask, Plane, TableCrop, grey
from neugrasp.geometry.pose import Array

EXPOSURE_LIMITS = Limits(0.25, 0.8)
"""Stops. Rendered captures in constant light measure up to 0.11."""
WHITE_BALANCE_LIMITS = Limits(0.15, 0.5)
"""Stops between two channels; rendered captures measure up to 0.07."""
SLOPE_LIMITS = Limits(0.5, 1.5)
"""Stops from corner to corner; large objects and their shadows give up to 0.35."""
OUTSIDE_LIMITS = Limits(5.0, 30.0)
"""Percent of what lies around the cube; shadows of objects give up to 1."""
WHITE_LIMITS = Limits(5.0, 30.0)
"""Percent of the cube's part of the photo."""
DARK_LIMITS = Limits(30.0, 80.0)
COMPARED = 0.3
"""Share of a crop that must show the same in both photos for the light to be compared."""
MARGIN = 6
"""Pixels around the cube in which its objects still cast shadows."""
LEAST_AROUND = 0.03
SHARE_IN_CUBE = 0.3
"""Share of a changed patch inside the cube from which on it is an object with its shadow."""
EVERYWHERE = 0.4
"""Share of the surroundings that no shadows of objects cover."""
LEAST_CHANGE = 0.3
"""Percent of the cube's part of the photo that objects change at the least."""
SHARPNESS = (0.7, 1.4, 2.8)
"""Standard deviations, pixels, between which fine and less fine detail are told apart."""
PAIR_LOSS, LOSS = Limits(1.25, 3.0), Limits(2.0, 4.0)
"""How many times less fine detail a photo may have than its fellow, which shows the same, and than usual."""
MOST_TIMES = 100.0
"""Largest of those ratios that is counted."""
SHARP = 0.5
"""Fine over coarser detail of a photo that is just in focus; rendered captures measure 0.6 and more."""
EDGE_LIMITS = Limits(6.3, np.inf)
"""Pixels across which the steepest edges rise; rendered ones measure 2.3 to 5.4, blurred by 3 pixels 7."""
STEEPEST, REACH, LEAST_STEP = 0.02, 9, 0.08
"""Share of the pixels that are edges, pixels across which one may rise, and its least height, of 1."""
BLACK, WHITE = 16, 250
"""Displayed values of 255."""
NOISE = 0.8 / 255
"""Detail below this strength is noise, and says nothing of sharpness."""


def check_light(crops: Sequence[TableCrop]) -> list[Finding]:
    """Exposure, white balance, moved light, changes around the cube, and whether anything stands in it."""
    drifts = [drift_of(crop) for crop in crops]
    comparable = [i for i, drift in enumerate(drifts) if drift.compared >= COMPARED]
    if not comparable:
        return [
            not_measured("light", "image and background have too little in common to compare their light")
        ]

    def drift(item: str, value: Callable[[Drift], float], limits: Limits, problem: Problem) -> Finding:
        values = [abs(value(drifts[i])) if i in comparable else 0.0 for i in range(len(crops))]
        return judged(item, values, limits, "EV", problem)

    findings = [
        drift("exposure", lambda d: d.exposure, EXPOSURE_LIMITS, EXPOSURE),
        drift("white balance", lambda d: d.white_balance, WHITE_BALANCE_LIMITS, WHITE_BALANCE),
        drift("light", lambda d: d.slope, SLOPE_LIMITS, LIGHT_MOVED),
    ]
    masks = [different(crop, one) for crop, one in zip(crops, drifts, strict=True)]
    return [*findings, *_changes(crops, drifts, masks, comparable)]


def _changes(
    crops: Sequence[TableCrop], drifts: Sequence[Drift], masks: Sequence[Mask], comparable: Sequence[int]
) -> list[Finding]:
    """What differs outside of the cube, and inside."""
    around = [_around(crop) for crop in crops]
    outside = [
        100 * _foreign(crops[i], drifts[i], masks[i], zone)
        if i in comparable and zone.mean() > LEAST_AROUND
        else 0.0
        for i, zone in enumerate(around)
    ]
    findings = [judged("around the cube", outside, OUTSIDE_LIMITS, "% changed", CHANGED_OUTSIDE, 1)]
    inside = [100 * float(m[s.inside].mean()) for m, s in zip(masks, crops, strict=True) if s.inside.any()]
    if inside:
        text = f"{min(inside):.1f} to {max(inside):.1f} % of the cube's part of the photo changed"
        empty = max(inside) < LEAST_CHANGE
        findings.append(
            Finding("in the cube", Level.YELLOW, text, NOTHING_THERE) if empty else green("in the cube", text)
        )
    return findings


def _foreign(crop: TableCrop, drift: Drift, mask: Mask, zone: Mask) -> float:
    """The share of what lies around the cube that changed, without the shadows that reach out of it: those of
    a low lamp are longer than the objects, and are known by their shade and by where they begin."""
    if not mask[zone].any():
        return 0.0
    shade, inside = shaded(crop, drift), crop.inside
    labels, count = ndimage.label(mask)
    begins_in_cube = np.asarray(
        ndimage.maximum(inside & ~shade, labels, np.arange(count + 1)), dtype=np.bool_
    )
    mask = mask & ~(shade & begins_in_cube[labels])
    labels, count = ndimage.label(mask)
    if float(mask[zone].mean()) > EVERYWHERE or count == 0:
        return float(mask[zone].mean())
    of_cube = ndimage.mean(inside, labels, np.arange(count + 1)) > SHARE_IN_CUBE
    of_cube[0] = True
    return float((~of_cube[labels])[zone].mean())


def _around(crop: TableCrop) -> Mask:
    """What is neither the cube nor so near to it that its objects' shadows fall there."""
    if not crop.inside.any():
        return np.zeros_like(crop.inside)
    return ~np.asarray(ndimage.binary_dilation(crop.inside, iterations=MARGIN))


def check_sharpness(crops: Sequence[TableCrop]) -> list[Finding]:
    """Whether a photo has less fine detail than its fellow or than the other views, and whether no edge is
    steep."""
    edges = judged("edges", [_edge_width(crop) for crop in crops], EDGE_LIMITS, "pixels wide", BLURRED, 1)
    details = [_details(crop) for crop in crops]
    known = [value for pair in details if pair is not None for value in pair]
    if not known:
        return [not_measured("sharpness", "too little texture to tell"), edges]
    usual = max(float(np.median(known)), SHARP)
    pairs = [_times(max(pair), min(pair)) if pair else 1.0 for pair in details]
    views = [_times(usual, min(pair)) if pair else 1.0 for pair in details]
    return [
        judged("sharpness of pairs", pairs, PAIR_LOSS, "times less fine detail in one of the two", BLURRED),
        judged("sharpness", views, LOSS, "times less fine detail than usual", BLURRED),
        edges,
    ]


def _times(more: float, less: float) -> float:
    """How many times as much; a black photo has no detail at all, which is no number."""
    return min(more / max(less, 1e-6), MOST_TIMES)


def _edge_width(crop: TableCrop) -> float:
    """Pixels across which the steepest edges in the cube rise; 0 where there are none."""
    inside = crop.inside if crop.inside.any() else np.ones_like(crop.inside)
    picture = ndimage.gaussian_filter(grey(crop.image), SHARPNESS[0])
    step = ndimage.maximum_filter(picture, REACH) - ndimage.minimum_filter(picture, REACH)
    slope = ndimage.gaussian_gradient_magnitude(grey(crop.image), SHARPNESS[0])
    steep = inside & (slope >= np.quantile(slope[inside], 1 - STEEPEST)) & (slope > 0)
    if not steep.any() or np.median(step[steep]) < LEAST_STEP:
        return 0.0
    return float(np.median(step[steep] / slope[steep]))


def _details(crop: TableCrop) -> tuple[float, float] | None:
    """Fine over coarser detail of image and background where both show the same; None without texture."""
    same = ~np.asarray(ndimage.binary_dilation(different(crop, drift_of(crop)), iterations=4))
    if same.mean() < COMPARED:
        same = np.ones_like(same)
    image, background = _detail(crop.image, same), _detail(crop.background, same)
    if max(image[1], background[1]) < NOISE:
        return None
    return image[0] / max(image[1], 1e-6), background[0] / max(background[1], 1e-6)


def _detail(picture: Plane, where: Mask) -> tuple[float, float]:
    """Strength (root mean square) of fine and of coarser detail."""
    a, b, c = (ndimage.gaussian_filter(grey(picture), sigma) for sigma in SHARPNESS)
    return _strength(a - b, where), _strength(b - c, where)


def _strength(detail: Array, where: Mask) -> float:
    return float(np.sqrt((detail[where] ** 2).mean()))


def check_brightness(crops: Sequence[TableCrop]) -> list[Finding]:
    """White and black parts of the photos, in the cube's part of them."""
    white, black = [], []
    for crop in crops:
        inside = crop.inside if crop.inside.any() else np.ones_like(crop.inside)
        pictures = (crop.image, crop.background)
        least, most = ([over_channels(of, p)[inside] for p in pictures] for of in (np.minimum, np.maximum))
        white.append(100 * max(float((values > WHITE / 255).mean()) for values in least))
        black.append(100 * max(float((values < BLACK / 255).mean()) for values in most))
    return [
        judged("saturation", white, WHITE_LIMITS, "% white", SATURATED, 1),
        judged("darkness", black, DARK_LIMITS, "% black", DARK, 1),
    ]
