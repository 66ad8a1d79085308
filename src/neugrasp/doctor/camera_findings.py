"""Intrinsics that suit the photos, and views that see the cube from enough directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from neugrasp.doctor.capture import Capture
from neugrasp.doctor.convention import in_view, slab
from neugrasp.doctor.findings import Finding, Level, Limits, green, judged, named
from neugrasp.doctor.messages import (
    FIELD_OF_VIEW,
    LITTLE_SEEN,
    NO_BASELINE,
    OTHER_RESOLUTION,
    PRINCIPAL_POINT,
    SAME_PLACE,
    SINGLE_VIEW,
    SMALL_IN_PHOTO,
    UNEQUAL_FOCAL,
    UNTRAINED_ANGLE,
    UNTRAINED_DISTANCE,
)
from neugrasp.doctor.table_crop import NETWORK_SIZE
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import inverse
from neugrasp.observation import Views

OFF_CENTRE = Limits(0.08, 0.30)
"""Distance of the principal point from the middle, in widths and heights of a photo that is not cropped."""
ASPECT = Limits(0.02, 0.20)
"""Difference of fx and fy over their mean."""
NARROW, WIDE = 15.0, 110.0
"""Degrees across the photo."""
RATIOS = (1 / 4, 1 / 3, 3 / 8, 1 / 2, 2 / 3, 3 / 4, 4 / 3, 3 / 2, 2.0, 9 / 4, 8 / 3, 3.0, 4.0)
"""Between the sizes of photos of one camera; a principal point is seldom exactly in the middle."""
SAME_SCALE = 0.04
"""By how much the two coordinates of a principal point may disagree about another resolution."""
TWICE_SEEN = 60.0, 25.0
"""Percent of the cube that two views or more should see: below the first yellow, below the second red."""
ANGLE = 8.0, 2.0
"""Degrees between the two views that are furthest apart: below the first yellow, below the second red."""
POLAR = 8.0, 55.0
"""Degrees off the vertical that training showed, with a margin."""
DISTANCES = 0.25, 1.2
"""Metres from the middle of the table."""
ENLARGED = Limits(2.8, 8.5)
"""How many times the crop of a photo is enlarged for the network."""


def check_intrinsics(capture: Capture) -> tuple[Capture, list[Finding]]:
    """Whether the intrinsics belong to the photos; the capture with those of another resolution scaled."""
    cameras = [view.camera for view in capture.views.frames]
    whole = [i for i, camera in enumerate(cameras) if camera.sensed is None]
    factors = {i: _other_resolution(cameras[i]) for i in whole}
    wrong = tuple(i for i in whole if factors[i] is not None)
    if wrong:
        camera, factor = cameras[wrong[0]], factors[wrong[0]] or 1.0
        size = f"{camera.width * factor:.0f} x {camera.height * factor:.0f}"
        here = f"{camera.width} x {camera.height}"
        text = f"the principal point is the middle of a photo of {size}, this one has {here}"
        mended = [
            replace(view, camera=_scaled(view.camera, 1 / (factors[i] or 1.0))) if i in wrong else view
            for i, view in enumerate(capture.views.frames)
        ]
        where = named(wrong, len(cameras))
        return capture.with_views(mended), [Finding("intrinsics", Level.RED, text, OTHER_RESOLUTION, where)]
    offset = [_off_centre(camera) if i in whole else 0.0 for i, camera in enumerate(cameras)]
    aspect = [abs(c.intrinsics[0, 0] / c.intrinsics[1, 1] - 1) for c in cameras]
    findings = [
        judged("principal point", offset, OFF_CENTRE, "of the photo off its middle", PRINCIPAL_POINT),
        judged("fx over fy", aspect, ASPECT, "off 1", UNEQUAL_FOCAL, 3),
        _field_of_view(cameras),
    ]
    return capture, findings


def _other_resolution(camera: Camera) -> float | None:
    """How many times larger a photo with its middle at the principal point would be; None for this size."""
    centre = (camera.intrinsics[:2, 2] + 0.5) / np.array([camera.width, camera.height]) * 2
    factor = float(centre.mean())
    simple = min(RATIOS, key=lambda ratio: abs(np.log(factor / ratio)))
    factor = simple if abs(factor / simple - 1) < 0.01 else factor
    is_consistent = abs(centre[0] - centre[1]) < SAME_SCALE * factor
    return factor if is_consistent and abs(np.log(factor)) > np.log(1.2) else None


def _scaled(camera: Camera, factor: float) -> Camera:
    """Pixel edges, not centres, scale: half a pixel is added before and taken away after."""
    intrinsics = camera.intrinsics * np.array([[factor], [factor], [1]])
    intrinsics[:2, 2] += (factor - 1) / 2
    return replace(camera, intrinsics=intrinsics)


def _off_centre(camera: Camera) -> float:
    size = np.array([camera.width, camera.height])
    return float(np.abs((camera.intrinsics[:2, 2] + 0.5) / size - 0.5).max())


def _field_of_view(cameras: Sequence[Camera]) -> Finding:
    angles = []
    for camera in cameras:
        left, top, right, bottom = camera.bounds
        spans = ((right - left) / camera.intrinsics[0, 0], (bottom - top) / camera.intrinsics[1, 1])
        angles.append(2 * float(np.rad2deg(np.arctan(max(spans) / 2))))
    text = f"{min(angles):.0f} to {max(angles):.0f} degrees"
    bad = tuple(i for i, angle in enumerate(angles) if not NARROW <= angle <= WIDE)
    if bad:
        return Finding("field of view", Level.YELLOW, text, FIELD_OF_VIEW, bad)
    return green("field of view", text)


def check_coverage(views: Views) -> list[Finding]:
    """How much of the cube how many views see, from how far apart, from where, and how large."""
    cameras = [view.camera.moved(inverse(views.workspace.world_from_workspace)) for view in views.frames]
    return [
        _seen(cameras, views),
        _size_in_photo(cameras, views),
        *_angles(cameras, views),
        *_places(cameras, views),
    ]


def _seen(cameras: Sequence[Camera], views: Views) -> Finding:
    points = slab(views.workspace)
    counts = np.sum([in_view(camera, points) for camera in cameras], axis=0)
    wanted = min(4, len(cameras))
    shares = [100 * float((counts >= n).mean()) for n in range(1, wanted + 1)]
    text = ", ".join(f"{share:.0f}" for share in shares) + " % of the cube seen by at least "
    text += ", ".join(str(n) for n in range(1, wanted + 1)) + (" views" if wanted > 1 else " view")
    enough = shares[min(1, wanted - 1)]
    level = Limits(-TWICE_SEEN[0], -TWICE_SEEN[1]).level(-enough)
    each = [float(in_view(camera, points).mean()) for camera in cameras]
    poor = tuple(i for i, share in enumerate(each) if 100 * share < TWICE_SEEN[0])
    if level == Level.GREEN and not poor:
        return green("coverage", text)
    if level == Level.GREEN:
        text = f"only {100 * min(each):.0f} % of the cube in the photo; {text}"
    return Finding("coverage", max(level, Level.YELLOW), text, LITTLE_SEEN, named(poor, len(each)))


def _size_in_photo(cameras: Sequence[Camera], views: Views) -> Finding:
    boxes = [views.workspace.photo_box(camera) for camera in cameras]
    sizes = [right - left for left, _, right, _ in boxes]
    too_small = [NETWORK_SIZE / size for size in sizes]
    text = f"{min(sizes):.0f} to {max(sizes):.0f} pixels"
    level = ENLARGED.level(max(too_small))
    if level == Level.GREEN:
        return green("size of the cube", text)
    bad = tuple(i for i, size in enumerate(too_small) if size > ENLARGED.yellow)
    return Finding("size of the cube", level, text, SMALL_IN_PHOTO, named(bad, len(sizes)))


def _angles(cameras: Sequence[Camera], views: Views) -> list[Finding]:
    """Angles, at the middle of the table, between the lines to the cameras."""
    if len(cameras) == 1:
        return [Finding("angles", Level.YELLOW, "1 view", SINGLE_VIEW)]
    middle = views.workspace.centre
    lines = [(camera.centre - middle) / np.linalg.norm(camera.centre - middle) for camera in cameras]
    pairs = {
        (i, j): float(np.rad2deg(np.arccos(np.clip(lines[i] @ lines[j], -1, 1))))
        for i, j in combinations(range(len(cameras)), 2)
    }
    base = max(float(np.linalg.norm(cameras[i].centre - cameras[j].centre)) for i, j in pairs)
    largest = max(pairs.values())
    text = f"{min(pairs.values()):.0f} to {largest:.0f} degrees between views, {base:.2f} m apart at most"
    level = Limits(-ANGLE[0], -ANGLE[1]).level(-largest)
    if level != Level.GREEN:
        return [Finding("angles", level, text, NO_BASELINE)]
    equal = [pair for pair, angle in pairs.items() if angle < 1]
    if equal:
        return [Finding("angles", Level.YELLOW, text, SAME_PLACE, equal[0])]
    return [green("angles", text)]


def _places(cameras: Sequence[Camera], views: Views) -> list[Finding]:
    """Directions and distances against those of training."""
    offsets = [camera.centre - views.workspace.centre for camera in cameras]
    distances = [float(np.linalg.norm(offset)) for offset in offsets]
    polar = [
        float(np.rad2deg(np.arccos(np.clip(o[2] / d, -1, 1))))
        for o, d in zip(offsets, distances, strict=True)
    ]
    findings = []
    for item, values, (low, high), unit, problem in (
        ("off the vertical", polar, POLAR, "degrees", UNTRAINED_ANGLE),
        ("distance", distances, DISTANCES, "m", UNTRAINED_DISTANCE),
    ):
        text = f"{min(values):.3g} to {max(values):.3g} {unit}"
        bad = tuple(i for i, value in enumerate(values) if not low <= value <= high)
        where = named(bad, len(values))
        findings.append(Finding(item, Level.YELLOW, text, problem, where) if bad else green(item, text))
    return findings
