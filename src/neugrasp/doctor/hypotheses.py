"""Single mistakes that would explain why the photos disagree about the table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from scipy.optimize import minimize

from neugrasp.doctor.capture import Capture
from neugrasp.doctor.findings import Problem
from neugrasp.doctor.messages import (
    FOCAL_LENGTH,
    MIRRORED,
    OTHER_RESOLUTION,
    TABLE_HEIGHT,
    TABLE_TILTED,
    VIEW_ORDER,
)
from neugrasp.doctor.table import COARSE_STEP, mean_correlation, table_picture, table_pictures
from neugrasp.doctor.table_crop import TableCrop, grey, table_crops
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, inverse, rigid, rotation_about

HEIGHTS = np.arange(-0.10, 0.1601, 0.01)
"""Metres above where the table should be."""
FOCAL_FACTORS = (*np.arange(0.5, 2.01, 0.05), 3.0)
HARMLESS = 0.15
"""Part of the focal length by which it may be wrong: 27 of 30 grasps hold at a tenth, none at its double."""
RESOLUTION_FACTORS = (0.5, 2 / 3, 0.75, 4 / 3, 1.5, 2.0)
HALF_RIGHT = 0.4, 0.9
"""Agreements of the best flat table between which tilted ones near it are tried."""
UNITS_OF_TILT = np.array([0.01, 0.035, 0.035])
"""Metres and radians (2 degrees): the first steps of the search."""
LEAST_TILT = 0.5
"""Degrees."""
MOST_VIEWS_PERMUTED = 4
TURNS = {
    "mirrored left to right": lambda picture: picture[:, ::-1],
    "mirrored top to bottom": lambda picture: picture[::-1],
    "upside down": lambda picture: picture[::-1, ::-1],
}


@dataclass(frozen=True)
class Hypothesis:
    """A mistake that would explain the photos."""

    problem: Problem
    text: str
    agreement: float
    """Mean correlation of the tables when it is undone."""
    mended: Capture | None = None
    """The capture without it, where that needs no other photos."""
    views: tuple[int, ...] = ()
    is_grave: bool = True
    """Whether grasps fail however near the photos have the table."""
    height: float = 0.0
    """Metres by which the table lies above where the cube expects it."""


@dataclass(frozen=True)
class Evidence:
    """What hypotheses are tried on."""

    capture: Capture
    crops: list[TableCrop]
    pairs: list[tuple[int, int]]
    """Those that can be compared as given."""
    odd: int | None
    """The only view that disagrees, where there is one."""

    @property
    def meant(self) -> tuple[int, ...]:
        """The views to change."""
        return tuple(range(len(self.crops))) if self.odd is None else (self.odd,)

    @property
    def named(self) -> tuple[int, ...]:
        """The views to name."""
        return () if self.odd is None else (self.odd,)

    def agreement(self, crops: list[TableCrop]) -> float:
        """The mean correlation of the tables of these crops."""
        return mean_correlation(table_pictures(crops, self.capture.views.workspace, COARSE_STEP), self.pairs)

    def with_cube_moved(self, old_from_new: Array) -> list[TableCrop]:
        """The crops if the cube lay elsewhere."""
        return [replace(crop, camera=crop.camera.moved(inverse(old_from_new))) for crop in self.crops]

    def with_cube(self, old_from_new: Array) -> Capture:
        """The capture with the cube elsewhere."""
        workspace = self.capture.views.workspace
        place = workspace.world_from_workspace @ old_from_new
        moved = replace(workspace, world_from_workspace=place)
        return replace(self.capture, views=replace(self.capture.views, workspace=moved))

    def taken_by(self, cameras: list[Camera]) -> list[TableCrop]:
        """The crops if these cameras (world frame, whole photos) had taken them."""
        workspace = self.capture.views.workspace
        return [replace(s, camera=s.seen_by(c, workspace)) for s, c in zip(self.crops, cameras, strict=True)]


def hypotheses(evidence: Evidence, is_far_off: bool) -> list[Hypothesis]:
    """All that were tried; the less likely ones only where the tables are far off."""
    height = best_height(evidence)
    found = [height, *_lenses(evidence)]
    if is_far_off:
        found += [*_tilt(evidence, height), *_orders(evidence), *_turns(evidence)]
    return found


def best_height(evidence: Evidence) -> Hypothesis:
    """The table elsewhere; refined to two millimetres around the best height."""

    def agreement(height: float) -> float:
        return evidence.agreement(evidence.with_cube_moved(rigid(translation=(0, 0, height))))

    coarse = max(HEIGHTS, key=agreement)
    best = float(max(np.arange(coarse - 0.008, coarse + 0.0081, 0.002), key=agreement))
    moved = evidence.with_cube(rigid(translation=(0, 0, best)))
    return Hypothesis(
        TABLE_HEIGHT, f"the table lies {_side(best)}", agreement(best), moved, is_grave=False, height=best
    )


def _side(height: float) -> str:
    return f"{abs(height) * 1000:.0f} mm {'above' if height > 0 else 'below'} where the cube expects it"


def _tilt(evidence: Evidence, flat: Hypothesis) -> Iterator[Hypothesis]:
    """The table tilted against the floor of the cube, sought from the best flat one if that is half right."""
    if not HALF_RIGHT[0] <= flat.agreement < HALF_RIGHT[1]:
        return
    workspace = evidence.capture.views.workspace

    def placed(values: Array) -> Array:
        height, about_x, about_y = values * UNITS_OF_TILT
        turn = rotation_about((1, 0, 0), about_x) @ rotation_about((0, 1, 0), about_y)
        middle = workspace.centre
        return rigid(turn, middle - turn @ middle + np.array([0, 0, height]))

    def disagreement(values: Array) -> float:
        return 1 - evidence.agreement(evidence.with_cube_moved(placed(values)))

    start = np.array([flat.height, 0, 0]) / UNITS_OF_TILT
    simplex = start + np.vstack([np.zeros(3), np.eye(3)])
    options = {"initial_simplex": simplex, "maxfev": 80, "xatol": 0.02, "fatol": 1e-3}
    best = minimize(disagreement, start, method="Nelder-Mead", options=options)
    height, about_x, about_y = best.x * UNITS_OF_TILT
    angle = float(np.rad2deg(np.hypot(about_x, about_y)))
    text = f"the table is tilted by {angle:.1f} degrees and its middle lies {_side(height)}"
    if angle > LEAST_TILT:
        yield Hypothesis(
            TABLE_TILTED, text, 1 - float(best.fun), evidence.with_cube(placed(best.x)), is_grave=False
        )


def _lenses(evidence: Evidence) -> Iterator[Hypothesis]:
    """Another focal length, or intrinsics of another resolution, of all views or of the odd one."""
    views = evidence.capture.views.frames
    for problem, scale, factors in (
        (FOCAL_LENGTH, _focal_scaled, FOCAL_FACTORS),
        (OTHER_RESOLUTION, _all_scaled, RESOLUTION_FACTORS),
    ):
        for factor in factors:
            cameras = [
                replace(view.camera, intrinsics=scale(view.camera.intrinsics, factor))
                if i in evidence.meant
                else view.camera
                for i, view in enumerate(views)
            ]
            what = "fx and fy" if problem is FOCAL_LENGTH else "all intrinsics"
            text = f"{what} times {factor:.3g} fit the photos"
            agreement, is_grave = evidence.agreement(evidence.taken_by(cameras)), abs(factor - 1) > HARMLESS
            yield Hypothesis(problem, text, agreement, None, evidence.named, is_grave)


def _focal_scaled(intrinsics: Array, factor: float) -> Array:
    return intrinsics * np.array([[factor, 1, 1], [1, factor, 1], [1, 1, 1]])


def _all_scaled(intrinsics: Array, factor: float) -> Array:
    """Pixel edges, not centres, scale: half a pixel is added before and taken away after."""
    scaled = intrinsics * np.array([[factor], [factor], [1]])
    scaled[:2, 2] += (factor - 1) / 2
    return scaled


def _orders(evidence: Evidence) -> Iterator[Hypothesis]:
    """Poses exchanged among the views."""
    views, workspace = evidence.capture.views.frames, evidence.capture.views.workspace
    count = len(views)
    if not 2 <= count <= MOST_VIEWS_PERMUTED:
        return
    cameras = [
        [replace(view.camera, world_from_camera=other.camera.world_from_camera) for other in views]
        for view in views
    ]
    tables = [
        [
            table_picture(grey(crop.background), crop.seen_by(camera, workspace), workspace, step=COARSE_STEP)
            for camera in row
        ]
        for crop, row in zip(evidence.crops, cameras, strict=True)
    ]
    for order in permutations(range(count)):
        moved = tuple(i for i in range(count) if order[i] != i)
        if moved:
            agreement = mean_correlation([tables[i][order[i]] for i in range(count)], evidence.pairs)
            text = "the poses exchanged (" + ", ".join(f"photo {i} with pose {order[i]}" for i in moved) + ")"
            changed = [replace(view, camera=cameras[i][order[i]]) for i, view in enumerate(views)]
            yield Hypothesis(VIEW_ORDER, text, agreement, evidence.capture.with_views(changed), moved)


def _turns(evidence: Evidence) -> Iterator[Hypothesis]:
    """Photos mirrored or upside down, all of them or the odd one; the whole photo turns about its middle."""
    views = evidence.capture.views
    for name, turn in TURNS.items():
        turned = [
            replace(view, image=turn(view.image), background=turn(view.background))
            if i in evidence.meant
            else view
            for i, view in enumerate(views.frames)
        ]
        agreement = evidence.agreement(table_crops(replace(views, frames=tuple(turned))))
        yield Hypothesis(MIRRORED, f"photos {name}", agreement, None, evidence.named)
