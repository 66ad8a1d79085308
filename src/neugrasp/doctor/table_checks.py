"""If the photos disagree about the table, which single mistake, undone, makes them agree?"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from neugrasp.doctor.capture import Capture
from neugrasp.doctor.findings import Finding, Level, Limits, Problem, green
from neugrasp.doctor.problems import (
    FOCAL_LENGTH,
    MIRRORED,
    OTHER_RESOLUTION,
    TABLE_HEIGHT,
    TABLE_OFFSET,
    VIEW_ORDER,
)
from neugrasp.doctor.shot import Shot, grey, shots_of
from neugrasp.doctor.table import (
    COARSE_STEP,
    Agreement,
    agreements,
    mean_correlation,
    table_picture,
    table_pictures,
)
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, rigid

UNQUESTIONED, AGREED = 0.9, 0.6
"""Correlations above which no explanation is sought, and above which a table counts as agreed upon."""
EXPLAINED, REST = 0.8, 0.5
"""Correlation that an explanation must reach, and share of the disagreement that it may leave."""
OFFSET = Limits(0.003, 0.010)
"""Metres by which tables may lie apart; a voxel has 7.5 mm."""
RELIABLE = 0.6
"""Correlation from which on a measured shift is believed."""
FAR = 0.02
"""Metres beyond which a shift is not believed of tables that agree unshifted."""
HOPELESS = 0.2
"""Correlation below which the cameras have nothing to do with the photos."""
HEIGHTS = np.arange(-0.10, 0.1601, 0.01)
"""Metres above where the table should be."""
FOCAL_FACTORS = (*np.arange(0.5, 2.01, 0.05), 3.0)
RESOLUTION_FACTORS = (0.5, 2 / 3, 0.75, 4 / 3, 1.5, 2.0)
MOST_VIEWS_PERMUTED = 4
TURNS = {
    "mirrored left to right": lambda picture: picture[:, ::-1],
    "mirrored top to bottom": lambda picture: picture[::-1],
    "upside down": lambda picture: picture[::-1, ::-1],
}


@dataclass(frozen=True)
class Explanation:
    """A mistake that would explain the photos."""

    problem: Problem
    text: str
    agreement: float
    """Mean correlation of the tables when it is undone."""
    mended: Capture | None = None
    """The capture without it, where that needs no other photos."""
    views: tuple[int, ...] = ()


def check_table(capture: Capture, without: Collection[int] = ()) -> tuple[Capture, list[Finding]]:
    """Whether all photos show the same table at the same place; a capture with a certain mistake undone.

    The backgrounds of the views in `without` are known to be wrong and do not count; no explanation is sought
    then.
    """
    views, shots = capture.views, shots_of(capture.views)
    pairs = agreements(table_pictures(shots, views.workspace))
    pairs = [pair for pair in pairs if pair.first not in without and pair.second not in without]
    if not pairs:
        return capture, [green("table", "too little texture, or one view, to compare the photos by")]
    lowest = min(pair.correlation for pair in pairs)
    if lowest >= UNQUESTIONED or without:
        return capture, [_offset(pairs) if all(map(_is_agreed, pairs)) else _unexplained(pairs, None)]
    odd = _odd_view(pairs, len(views))
    trial = _Trial(capture, shots, [(pair.first, pair.second) for pair in pairs], odd)
    found = [*_heights(trial), *_lenses(trial)]
    if lowest < AGREED:
        found += [*_orders(trial), *_turns(trial)]
    best = max(found, key=lambda explanation: explanation.agreement)
    now = trial.agreement(shots)
    if best.agreement >= EXPLAINED and 1 - best.agreement < REST * (1 - now):
        text = f"{best.text}: the photos then agree by {best.agreement:.2f} of 1, as given by {now:.2f}"
        return best.mended or capture, [Finding("table", Level.RED, text, best.problem, best.views)]
    return capture, [_offset(pairs) if all(map(_is_agreed, pairs)) else _unexplained(pairs, odd)]


@dataclass(frozen=True)
class _Trial:
    """What explanations are tried on."""

    capture: Capture
    shots: list[Shot]
    pairs: list[tuple[int, int]]
    """Those that can be compared as given."""
    odd: int | None
    """The only view that disagrees, where there is one."""

    @property
    def meant(self) -> tuple[int, ...]:
        """The views to change."""
        return tuple(range(len(self.shots))) if self.odd is None else (self.odd,)

    @property
    def named(self) -> tuple[int, ...]:
        """The views to name."""
        return () if self.odd is None else (self.odd,)

    def agreement(self, shots: list[Shot], raised: float = 0.0) -> float:
        """The mean correlation of the tables of these shots."""
        pictures = table_pictures(shots, self.capture.views.workspace, raised, COARSE_STEP)
        return mean_correlation(pictures, self.pairs)

    def taken_by(self, cameras: list[Camera]) -> list[Shot]:
        """The shots if these cameras (world frame, whole photos) had taken them."""
        workspace = self.capture.views.workspace
        return [replace(s, camera=s.seen_by(c, workspace)) for s, c in zip(self.shots, cameras, strict=True)]


def _is_agreed(pair: Agreement) -> bool:
    """Whether two photos show the table at the same place, though perhaps with other reflections on it."""
    is_there = pair.shift.agreement > RELIABLE and OFFSET.level(pair.offset) == Level.GREEN
    return pair.correlation >= AGREED or is_there


def _offset(pairs: list[Agreement]) -> Finding:
    """Of tables that agree: by how much they lie apart."""
    # A regular pattern covers itself again a period further on: far shifts of tables that agree do not count.
    reliable = [
        pair
        for pair in pairs
        if pair.shift.agreement > RELIABLE and (pair.offset < FAR or pair.correlation < AGREED)
    ]
    offset = max((pair.offset for pair in reliable), default=0.0)
    text = f"the photos of the table agree by {_mean(pairs):.2f} of 1, at most {offset * 1000:.1f} mm apart"
    level = OFFSET.level(offset)
    return green("table", text) if level == Level.GREEN else Finding("table", level, text, TABLE_OFFSET)


def _unexplained(pairs: list[Agreement], odd: int | None) -> Finding:
    """Of tables that disagree for no reason that was tried."""
    worst = min(pairs, key=lambda pair: pair.correlation)
    text = f"the photos of the table agree by {_mean(pairs):.2f} of 1 only"
    level = Level.YELLOW
    if worst.shift.agreement > RELIABLE:
        text += f"; up to {worst.offset * 1000:.0f} mm apart"
        level = max(level, OFFSET.level(worst.offset))
    elif _mean(pairs) < HOPELESS:
        level = Level.RED
    return Finding("table", level, text, TABLE_OFFSET, () if odd is None else (odd,))


def _mean(pairs: list[Agreement]) -> float:
    return float(np.mean([pair.correlation for pair in pairs]))


def _odd_view(pairs: list[Agreement], count: int) -> int | None:
    """The one view that agrees with none while the others agree with each other."""
    for odd in range(count):
        of_odd = [pair.correlation for pair in pairs if odd in (pair.first, pair.second)]
        others = [pair.correlation for pair in pairs if odd not in (pair.first, pair.second)]
        if of_odd and others and max(of_odd) < min(others) and min(others) >= AGREED:
            return odd
    return None


def _heights(trial: _Trial) -> Iterator[Explanation]:
    """The table elsewhere; refined to two millimetres around the best height."""

    def agreement(raised: float) -> float:
        return trial.agreement(trial.shots, raised)

    coarse = max(HEIGHTS, key=agreement)
    best = float(max(np.arange(coarse - 0.008, coarse + 0.0081, 0.002), key=agreement))
    workspace = trial.capture.views.workspace
    place = workspace.world_from_workspace @ rigid(translation=(0, 0, best))
    moved = replace(trial.capture.views, workspace=replace(workspace, world_from_workspace=place))
    side = "above" if best > 0 else "below"
    text = f"the table lies {abs(best) * 1000:.0f} mm {side} where the cube expects it"
    yield Explanation(TABLE_HEIGHT, text, agreement(best), replace(trial.capture, views=moved))


def _lenses(trial: _Trial) -> Iterator[Explanation]:
    """Another focal length, or intrinsics of another resolution, of all views or of the odd one."""
    views = trial.capture.views.views
    for problem, scale, factors in (
        (FOCAL_LENGTH, _focal_scaled, FOCAL_FACTORS),
        (OTHER_RESOLUTION, _all_scaled, RESOLUTION_FACTORS),
    ):
        for factor in factors:
            cameras = [
                replace(view.camera, intrinsics=scale(view.camera.intrinsics, factor))
                if i in trial.meant
                else view.camera
                for i, view in enumerate(views)
            ]
            what = "fx and fy" if problem is FOCAL_LENGTH else "all intrinsics"
            text = f"{what} times {factor:.3g} fit the photos"
            yield Explanation(problem, text, trial.agreement(trial.taken_by(cameras)), None, trial.named)


def _focal_scaled(intrinsics: Array, factor: float) -> Array:
    return intrinsics * np.array([[factor, 1, 1], [1, factor, 1], [1, 1, 1]])


def _all_scaled(intrinsics: Array, factor: float) -> Array:
    """Pixel edges, not centres, scale: half a pixel is added before and taken away after."""
    scaled = intrinsics * np.array([[factor], [factor], [1]])
    scaled[:2, 2] += (factor - 1) / 2
    return scaled


def _orders(trial: _Trial) -> Iterator[Explanation]:
    """Poses exchanged among the views."""
    views, workspace = trial.capture.views.views, trial.capture.views.workspace
    count = len(views)
    if not 2 <= count <= MOST_VIEWS_PERMUTED:
        return
    cameras = [
        [replace(view.camera, world_from_camera=other.camera.world_from_camera) for other in views]
        for view in views
    ]
    tables = [
        [
            table_picture(grey(shot.background), shot.seen_by(camera, workspace), workspace, step=COARSE_STEP)
            for camera in row
        ]
        for shot, row in zip(trial.shots, cameras, strict=True)
    ]
    for order in permutations(range(count)):
        moved = tuple(i for i in range(count) if order[i] != i)
        if moved:
            agreement = mean_correlation([tables[i][order[i]] for i in range(count)], trial.pairs)
            text = "the poses exchanged (" + ", ".join(f"photo {i} with pose {order[i]}" for i in moved) + ")"
            changed = [replace(view, camera=cameras[i][order[i]]) for i, view in enumerate(views)]
            yield Explanation(VIEW_ORDER, text, agreement, trial.capture.with_views(changed), moved)


def _turns(trial: _Trial) -> Iterator[Explanation]:
    """Photos mirrored or upside down, all of them or the odd one; the whole photo turns about its middle."""
    views = trial.capture.views
    for name, turn in TURNS.items():
        turned = [
            replace(view, image=turn(view.image), background=turn(view.background))
            if i in trial.meant
            else view
            for i, view in enumerate(views.views)
        ]
        agreement = trial.agreement(shots_of(replace(views, views=tuple(turned))))
        yield Explanation(MIRRORED, f"photos {name}", agreement, None, trial.named)
