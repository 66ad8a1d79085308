"""Whether the photos agree about the table, and if not, whether a single mistake explains it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from neugrasp.doctor.capture import Capture
from neugrasp.doctor.findings import Finding, Level, Limits, green, not_measured
from neugrasp.doctor.hypotheses import Evidence, hypotheses
from neugrasp.doctor.messages import (
    POSES_UNCHECKED,
    SCALE_UNCHECKED,
    TABLE_HEIGHT,
    TABLE_OFFSET,
    TABLE_TILTED,
)
from neugrasp.doctor.table import (
    RELIABLE,
    Agreement,
    TablePicture,
    agreements,
    comparable,
    correlation,
    table_pictures,
)
from neugrasp.doctor.table_crop import table_crops

CERTAIN, AGREED = 0.9, 0.6
"""Correlations above which an hypothesis is certain, and above which a table counts as agreed upon."""
AGREED_COARSELY = 0.9
"""Correlation of quick looks from which on nothing else is asked."""
EXPLAINED, REST = 0.8, 0.5
"""Correlation that an hypothesis must reach, and share of the disagreement that it may leave."""
OFFSET = Limits(0.003, 0.015)
"""Metres by which two photos may have the table apart, about as far as grasps will be off. Executed on packed
glass and steel (docs/capture.md), nearly all hold up to 11 mm, four of five at 20, two of five at 40."""
FAR = 0.02
"""Metres beyond which a shift is not believed of tables that agree unshifted."""
UNSEEN = (
    "poses that are 4 degrees wrong, and focal lengths that are twice too long, with which most grasps fail, "
    "may go unseen"
)
"""Said of plain tables and single views (docs/capture.md)."""
HOPELESS = 0.2
"""Correlation below which the cameras have nothing to do with the photos."""


def check_table(capture: Capture, without: Collection[int] = ()) -> tuple[Capture, list[Finding]]:
    """Whether all photos show the same table at the same place; a capture with a certain mistake undone.

    How far the photos have it apart decides about the level, whatever the cause. The backgrounds of the views
    in `without` are known to be wrong and do not count; no hypothesis is sought then.
    """
    views, crops = capture.views, table_crops(capture.views)
    pairs = agreements(table_pictures(crops, views.workspace))
    pairs = [pair for pair in pairs if pair.first not in without and pair.second not in without]
    if not pairs:
        return capture, [_unknown(len(views) - len(without))]
    as_given = _as_given(pairs)
    lowest = min(pair.correlation for pair in pairs)
    if without or (as_given.level == Level.GREEN and lowest >= AGREED):
        return capture, [as_given]
    odd = _odd_view(pairs, len(views))
    evidence = Evidence(capture, crops, [(pair.first, pair.second) for pair in pairs], odd)
    # What is wrong with all may show in one.
    trials = [evidence, replace(evidence, odd=None)] if odd is not None else [evidence]
    found = [one for some in trials for one in hypotheses(some, is_far_off=lowest < AGREED)]
    best = max(found, key=lambda one: one.agreement)
    now = evidence.agreement(crops)
    if best.agreement < EXPLAINED or 1 - best.agreement >= REST * (1 - now):
        where = () if odd is None or all(map(_is_agreed, pairs)) else (odd,)
        return capture, [replace(as_given, views=where)]
    text = f"{best.text}: the photos then agree by {best.agreement:.2f} of 1, as given by {now:.2f}"
    level = max(as_given.level, Level.YELLOW)
    if best.is_grave or not all(map(_is_reliable, pairs)):
        level = Level.RED
    elif best.problem in (TABLE_HEIGHT, TABLE_TILTED):
        text += _consequence(_offset(pairs))
    finding = Finding("table", level, text, best.problem, best.views)
    is_certain = best.mended is not None and best.agreement >= CERTAIN
    return best.mended if is_certain and best.mended else capture, [finding]


def check_scale() -> Finding:
    """What no photo tells."""
    return not_measured("scale", "photos look the same at any scale", SCALE_UNCHECKED)


def check_table_quickly(capture: Capture, pictures: Sequence[TablePicture]) -> tuple[Capture, list[Finding]]:
    """As `check_table`, which is asked where a look at `coarse_pictures` leaves doubts only."""
    values = [correlation(pictures[i], pictures[j]) or 0.0 for i, j in comparable(pictures)]
    if values and min(values) < AGREED_COARSELY:
        return check_table(capture)
    if not values:
        return capture, [_unknown(len(capture.views))]
    return capture, [green("table", f"the photos of the table agree by {np.mean(values):.2f} of 1")]


def _unknown(count: int) -> Finding:
    """The finding for so many views that cannot be compared."""
    why = "too little texture on the table" if count > 1 else "fewer than two views to compare"
    return not_measured("table", f"{why}; {UNSEEN}", POSES_UNCHECKED)


def _as_given(pairs: list[Agreement]) -> Finding:
    """By how much the photos have the table apart, and whether that matters."""
    offset, mean = _offset(pairs), float(np.mean([pair.correlation for pair in pairs]))
    text = f"the photos of the table agree by {mean:.2f} of 1"
    if all(map(_is_agreed, pairs)) or all(map(_is_reliable, pairs)):
        level = OFFSET.level(offset)
        text += f", at most {1000 * offset:.1f} mm apart"
    else:
        level = max(Level.RED if mean < HOPELESS else Level.YELLOW, OFFSET.level(offset))
        text += " only"
    if level == Level.GREEN:
        return green("table", text)
    return Finding("table", level, text + _consequence(offset), TABLE_OFFSET)


def _consequence(offset: float) -> str:
    return f"; grasps may be off by {1000 * offset:.0f} mm" if offset > OFFSET.yellow else ""


def _is_reliable(pair: Agreement) -> bool:
    """Whether the measured shift is to be believed.

    A regular pattern covers itself again a period further on: far shifts of tables that agree do not count.
    """
    return pair.shift.agreement > RELIABLE and (pair.offset < FAR or pair.correlation < AGREED)


def _is_agreed(pair: Agreement) -> bool:
    """Whether two photos show the table at the same place, though perhaps with other reflections on it."""
    return pair.correlation >= AGREED


def _offset(pairs: list[Agreement]) -> float:
    """Metres: the largest shift that is to be believed."""
    return max((pair.offset for pair in pairs if _is_reliable(pair)), default=0.0)


def _odd_view(pairs: list[Agreement], count: int) -> int | None:
    """The one view that agrees with none while the others agree with each other."""
    for odd in range(count):
        of_odd = [pair.correlation for pair in pairs if odd in (pair.first, pair.second)]
        others = [pair.correlation for pair in pairs if odd not in (pair.first, pair.second)]
        if of_odd and others and max(of_odd) < min(others) and min(others) >= AGREED:
            return odd
    return None
