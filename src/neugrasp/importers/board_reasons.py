"""Why markers that are seen do not fit the board that was described, and what would."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from neugrasp.geometry.pose import Array
from neugrasp.importers.board import Charuco, Tag, Tags
from neugrasp.importers.planar_fit import Fit, fit, mapped
from neugrasp.importers.seen_markers import Seen

FEWEST_MARKERS = 4
"""Fewest markers of a chessboard that tell its pattern."""
PATTERN = 0.25
"""Share of a marker's edge in the photo by which markers may be off their pattern."""
LARGEST_BOARD = 16
"""Columns and rows that are tried."""


def fit_of(corners: Mapping[int, Array], seen: Seen) -> Fit | None:
    """How markers at `corners` (4, 3) fit those seen; None where none of them is."""
    known = [number for number in corners if number in seen]
    if not known:
        return None
    return fit(
        np.concatenate([corners[number] for number in known]),
        np.concatenate([seen[number] for number in known]),
    )


def error_of(corners: Mapping[int, Array], seen: Seen) -> float:
    """Root mean square distance in pixels of the markers from where a flat board at `corners` has them."""
    found = fit_of(corners, seen)
    return np.inf if found is None else found.error


def _is_pattern(board: Charuco, seen: Seen) -> bool:
    """Whether the markers are those of a chessboard: another pattern puts them off by whole squares. Lenses
    that are not straightened yet bend it by less."""
    markers = board.markers()
    if max(seen) >= len(markers):
        return False
    edges = np.concatenate([pixels - np.roll(pixels, 1, axis=0) for pixels in seen.values()])
    side = float(np.linalg.norm(edges, axis=-1).mean())
    return error_of(dict(enumerate(markers)), seen) < PATTERN * side


def charuco_reason(board: Charuco, seen: Seen) -> str | None:
    """What is wrong with the description of a chessboard; None where the markers fit it, or are too few."""
    if len(seen) < FEWEST_MARKERS:
        return None
    described = f"{board.columns} x {board.rows} squares"
    own = {number: pixels for number, pixels in seen.items() if number < len(board.markers())}
    is_own = len(own) >= FEWEST_MARKERS and _is_pattern(board, own)
    if is_own and len(own) == len(seen):
        return None
    for words, other in _other_patterns(board):
        if _is_pattern(other, seen):
            return f"{len(seen)} markers are seen, but not where {described} have them; {words}"
    if is_own:
        # What is seen besides is no marker of this board: patterns of four by four are found in clutter, too.
        return None
    return (
        f"{len(seen)} markers of {board.dictionary} are seen, but not where {described} have them; check "
        "columns, rows, square and marker, and that there is only one board, flat and whole, in the photo"
    )


def missing_row(board: Charuco, seen: Seen, width: int, height: int) -> str | None:
    """Whether the lowest row was described and not printed: it alone is not seen, and would be in the "
    "photo."""
    markers = _numbered(board)
    lowest = [number for number, corners in markers.items() if corners[:, 1].max() < board.square]
    above = {number: corners for number, corners in markers.items() if number not in lowest}
    if not set(above) <= set(seen) or set(lowest) & set(seen):
        return None
    found = fit_of(above, seen)
    assert found is not None
    pixels = mapped(found.matrix, np.concatenate([markers[number] for number in lowest]))
    if not np.all((pixels > 0) & (pixels < [width, height])):
        return None
    return (
        f"all markers are seen but those of the lowest row, which would be in the photo: has the print "
        f"{board.rows - 1} rows, not {board.rows}?"
    )


def _numbered(board: Charuco) -> dict[int, Array]:
    return dict(enumerate(board.markers()))


def _other_patterns(board: Charuco) -> Iterator[tuple[str, Charuco]]:
    """Boards that may have been printed instead, with what to write; the likeliest first."""
    legacy = 'write "legacy": true' if not board.legacy else 'leave "legacy" away'
    pattern = (
        "they fit the legacy pattern of OpenCV before 4.6 and of calib.io"
        if not board.legacy
        else "they fit the pattern of OpenCV 4.6 and later, not the legacy pattern"
    )
    yield f"{pattern}: {legacy}", replace(board, legacy=not board.legacy)
    turned = replace(board, columns=board.rows, rows=board.columns)
    words = f"rows and columns are exchanged: they fit {turned.columns} columns and {turned.rows} rows"
    yield words, turned
    yield f"{words}, and {pattern}: {legacy}", replace(turned, legacy=not board.legacy)
    sizes = [(c, r) for c in range(3, LARGEST_BOARD) for r in range(3, LARGEST_BOARD)]
    near = sorted(sizes, key=lambda size: abs(size[0] - board.columns) + abs(size[1] - board.rows))
    for columns, rows in near:
        for is_legacy in (board.legacy, not board.legacy):
            words = f"they fit {columns} columns and {rows} rows" + (
                f", and {pattern}: {legacy}" if is_legacy != board.legacy else ""
            )
            yield words, replace(board, columns=columns, rows=rows, legacy=is_legacy)


def tags_reason(tags: Tags, seen: Seen, limit: float) -> str:
    """Why tags that are seen are not where the board has them, from errors of up to `limit` pixels on."""
    corners = {tag.number: tag.corners for tag in tags.tags}
    known = {number: seen[number] for number in corners if number in seen}
    where = "the tags seen do not lie as the board's file has them"
    if error_of({number: np.roll(own, 2, axis=0) for number, own in corners.items()}, known) <= limit:
        other = "opencv" if tags.upright == "official" else "official"
        return f'{where}: each is turned by 180 degrees; write "upright": "{other}"'
    for one, two in combinations(known, 2):
        if error_of(corners, {**known, one: known[two], two: known[one]}) <= limit:
            return f"{where}: the numbers {one} and {two} are exchanged"
    sized = {
        ratio: error_of({tag.number: replace(tag, size=ratio * tag.size).corners for tag in tags.tags}, known)
        for ratio in np.linspace(0.5, 2.0, 151)
    }
    ratio = min(sized, key=sized.__getitem__)
    odd = _odd_one(tags, known, limit)
    if sized[ratio] <= limit and (odd is None or sized[ratio] < odd[0]):
        sizes = ", ".join(f"{1000 * ratio * tag.size:.0f}" for tag in tags.tags if tag.number in known)
        # Of two tags nobody can tell whether they are larger or nearer to each other.
        what = " and the distance of the 'centre's" if len(known) == 2 else ""
        return f"{where}: measure 'size' (the edge of the black square){what}; {sizes} mm would fit"
    if odd is not None:
        return f"{where}: {odd[1]}"
    return f"{where}; measure 'centre', 'size' and 'turn_deg' of the tags {', '.join(map(str, known))}"


def _odd_one(tags: Tags, known: Seen, limit: float) -> tuple[float, str] | None:
    """The error without the tag without which the others fit best, and where it lies; None where they do "
    "not."""
    if len(known) < 3:
        return None
    by_number = {tag.number: tag for tag in tags.tags}
    rests = {odd: {other: by_number[other].corners for other in known if other != odd} for odd in known}
    odd = min(rests, key=lambda number: error_of(rests[number], known))
    found = fit_of(rests[odd], known)
    if found is None or found.error > limit:
        return None
    return found.error, _misplaced(by_number[odd], mapped(np.linalg.inv(found.matrix), known[odd]))


def _misplaced(tag: Tag, corners: Array) -> str:
    """How a tag lies whose corners (4, 2) are seen in the board's plane."""
    shift = np.linalg.norm(corners.mean(axis=0) - tag.centre)
    up = corners[:2].mean(axis=0) - corners[2:].mean(axis=0)
    turn = np.rad2deg(np.arctan2(-up[0], up[1]) - tag.turn)
    size = float(np.mean([np.linalg.norm(corners[i] - corners[i - 1]) for i in range(4)]))
    x, y = corners.mean(axis=0)
    return (
        f"tag {tag.number} lies {1000 * shift:.0f} mm away from its 'centre', turned by "
        f"{(turn + 180) % 360 - 180:.0f} degrees, {1000 * size:.0f} mm large; the others fit with it at "
        f"[{x:.3f}, {y:.3f}]"
    )
