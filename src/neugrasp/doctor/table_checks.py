"""Whether the photos agree about the table, and if not, whether a single mistake explains it."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from neugrasp.doctor.capture import Capture
from neugrasp.doctor.explanations import Trial, explanations
from neugrasp.doctor.findings import Finding, Level, Limits, green
from neugrasp.doctor.problems import TABLE_OFFSET
from neugrasp.doctor.shot import shots_of
from neugrasp.doctor.table import Agreement, agreements, table_pictures

UNQUESTIONED, AGREED = 0.9, 0.6
"""Correlations above which no explanation is sought and one is certain, and above which a table counts as
agreed upon."""
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
    trial = Trial(capture, shots, [(pair.first, pair.second) for pair in pairs], odd)
    best = max(explanations(trial, is_far_off=lowest < AGREED), key=lambda one: one.agreement)
    now = trial.agreement(shots)
    if best.agreement >= EXPLAINED and 1 - best.agreement < REST * (1 - now):
        text = f"{best.text}: the photos then agree by {best.agreement:.2f} of 1, as given by {now:.2f}"
        finding = Finding("table", Level.RED, text, best.problem, best.views)
        is_certain = best.mended is not None and best.agreement >= UNQUESTIONED
        return best.mended if is_certain and best.mended else capture, [finding]
    return capture, [_offset(pairs) if all(map(_is_agreed, pairs)) else _unexplained(pairs, odd)]


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
