"""Why markers that are seen do not fit the board that was described, and what would."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from neugrasp.geometry.pose import Array
from neugrasp.importers.board import Charuco, Tag, Tags
from neugrasp.importers.planar_fit import Fit, fit, limit_of, mapped

FEWEST_MARKERS = 4
"""Of a chessboard, to tell its pattern by."""
LARGEST_BOARD = 16
"""Columns and rows that are tried."""

Seen = Mapping[int, Array]
"""Ideal pixels (4, 2) of the corners of markers, by number."""


def listed(numbers: Iterable[int]) -> str:
    """The first few numbers, in order."""
    words = [str(number) for number in sorted(numbers)]
    return ", ".join(words[:8]) + (", ..." if len(words) > 8 else "")


def fit_of(corners: Mapping[int, Array], seen: Seen) -> Fit | None:
    """How markers at `corners` (4, 3) fit those seen; None where none of them is."""
    known = [number for number in corners if number in seen]
    if not known:
        return None
    return fit(
        np.concatenate([corners[number] for number in known]),
        np.concatenate([seen[number] for number in known]),
    )


def is_fitting(corners: Mapping[int, Array], seen: Seen) -> bool:
    """Whether the markers are where a flat board at `corners` has them."""
    found = fit_of(corners, seen)
    pixels = np.concatenate([seen[number] for number in corners if number in seen] or [np.zeros((1, 2))])
    return found is not None and found.error <= limit_of(pixels)


def charuco_reason(board: Charuco, seen: Seen) -> str | None:
    """What is wrong with the description of a chessboard; None where the markers fit it, or are too few."""
    if len(seen) < FEWEST_MARKERS:
        return None
    described = f"{board.columns} x {board.rows} squares"
    own = {number: pixels for number, pixels in seen.items() if number < len(board.markers())}
    is_own = len(own) >= FEWEST_MARKERS and is_fitting(_numbered(board), own)
    if is_own and len(own) == len(seen):
        return None
    for words, other in _other_patterns(board):
        if max(seen) < len(other.markers()) and is_fitting(_numbered(other), seen):
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


def tags_reason(tags: Tags, seen: Seen) -> str:
    """Why tags that are seen are not where the board has them."""
    corners = {tag.number: tag.corners for tag in tags.tags}
    known = {number: seen[number] for number in corners if number in seen}
    where = "the tags seen do not lie as board.json has them"
    if is_fitting({number: np.roll(own, 2, axis=0) for number, own in corners.items()}, known):
        other = "opencv" if tags.upright == "official" else "official"
        return f'{where}: each is turned by 180 degrees; write "upright": "{other}"'
    for one, other_tag in combinations(known, 2):
        swapped = {**known, one: known[other_tag], other_tag: known[one]}
        if is_fitting(corners, swapped):
            return f"{where}: the numbers {one} and {other_tag} are exchanged"
    for ratio in np.linspace(0.5, 2.0, 61):
        if is_fitting({tag.number: replace(tag, size=ratio * tag.size).corners for tag in tags.tags}, known):
            sizes = ", ".join(f"{1000 * ratio * tag.size:.0f}" for tag in tags.tags if tag.number in known)
            return f"{where}: measure 'size', the edge of the black square; {sizes} mm would fit"
    if odd := _odd_one(tags, known):
        return f"{where}: {odd}"
    return f"{where}; measure 'centre', 'size' and 'turn_deg' of the tags {', '.join(map(str, known))}"


def _odd_one(tags: Tags, known: Seen) -> str | None:
    """The one tag without which the others fit, and where it lies."""
    if len(known) < 3:
        return None
    by_number = {tag.number: tag for tag in tags.tags}
    for number in known:
        others = {other: by_number[other].corners for other in known if other != number}
        if is_fitting(others, known):
            found = fit_of(others, known)
            assert found is not None
            return _misplaced(by_number[number], mapped(np.linalg.inv(found.matrix), known[number]))
    return None


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
