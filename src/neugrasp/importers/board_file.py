"""`board.json`: what was printed, as a user wrote it down."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.camera_checks import numbers
from neugrasp.data.known_keys import refuse_unknown
from neugrasp.data.strict_json import read_object
from neugrasp.errors import InputError
from neugrasp.importers.board import Board, Charuco, Tag, Tags, Upright
from neugrasp.importers.files import pose_of

COMMON_KEYS = ("kind", "dictionary", "board_from_workspace")
CHARUCO_KEYS = (*COMMON_KEYS, "columns", "rows", "square", "marker", "legacy")
TAGS_KEYS = (*COMMON_KEYS, "tags", "upright")
TAG_KEYS = ("id", "size", "centre", "center", "turn_deg")
ANGLES = ("turn", "turn_rad", "turn_degrees", "angle", "rotation", "yaw", "theta", "orientation")
"""Keys of a tag that say a turn in another way."""
MOST_SQUARES = 100


def read_board(name: str) -> Board:
    """The board of a file, or the one called `default`. Raises `InputError` naming file and field.

    `{"kind": "charuco", "columns": 7, "rows": 5, "square": 0.036, "marker": 0.027,
    "dictionary": "DICT_4X4_50", "legacy": false}` or `{"kind": "tags", "dictionary": "DICT_APRILTAG_36h11",
    "upright": "official", "tags": [{"id": 0, "size": 0.05, "centre": [x, y], "turn_deg": 0}]}`, either with
    `board_from_workspace`.
    """
    if name == "default":
        return Board()
    file = Path(name)
    data = read_object(file, "a board")
    kind = data.get("kind")
    if kind not in ("charuco", "tags"):
        raise InputError(f"{file}: kind is {kind!r}; it must be 'charuco' or 'tags'")
    keys = CHARUCO_KEYS if kind == "charuco" else TAGS_KEYS
    refuse_unknown(data, keys, str(file))
    place = data.get("board_from_workspace")
    pose = None if place is None else pose_of(place, f"{file}: board_from_workspace")
    return Board(_charuco(data, file) if kind == "charuco" else _tags(data, file), pose)


def _charuco(data: dict[str, Any], file: Path) -> Charuco:
    standard = Charuco()

    def value(key: str) -> float:
        return float(numbers(data.get(key, getattr(standard, key)), (), f"{file}: {key}"))

    def whole(key: str) -> int:
        return _whole(data.get(key, getattr(standard, key)), f"{file}: {key}")

    legacy = data.get("legacy", False)
    if not isinstance(legacy, bool):
        raise InputError(f"{file}: legacy is {legacy!r}; it must be true or false")
    board = Charuco(
        whole("columns"),
        whole("rows"),
        value("square"),
        value("marker"),
        _dictionary(data, standard.dictionary, file),
        legacy,
    )
    is_counted = min(board.columns, board.rows) >= 3 and max(board.columns, board.rows) <= MOST_SQUARES
    if not (is_counted and 0.005 <= board.marker < board.square <= 0.2):
        raise InputError(
            f"{file}: needs 3 to {MOST_SQUARES} columns and rows, and 0.005 m <= marker < square <= 0.2 m "
            "(metres!)"
        )
    return board


def _tags(data: dict[str, Any], file: Path) -> Tags:
    entries = data.get("tags")
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{file}: 'tags' must be a list of at least one tag")
    upright: Upright | None = data.get("upright")
    if upright not in ("official", "opencv", None):
        raise InputError(f"{file}: upright is {upright!r}; it must be 'official' or 'opencv'")
    tags = tuple(_tag(entry, f"{file}, tag {i}") for i, entry in enumerate(entries))
    named = [tag.number for tag in tags]
    if twice := [number for number in named if named.count(number) > 1]:
        raise InputError(f"{file}: two tags have the number {twice[0]}; every tag needs a number of its own")
    for i, tag in enumerate(tags):
        for other in tags[:i]:
            if np.linalg.norm(np.subtract(tag.centre, other.centre)) < (tag.size + other.size) / 2:
                raise InputError(
                    f"{file}: the tags {other.number} and {tag.number} lie on each other; 'centre' is in "
                    "metres from the board's origin"
                )
    return Tags(tags, _dictionary(data, "DICT_APRILTAG_36h11", file), upright)


def _tag(entry: Any, where: str) -> Tag:
    if not _is_object(entry):
        raise InputError(f"{where}: must be an object with id, size, centre")
    for key in ANGLES:
        if key in entry and entry[key] != 0:
            raise InputError(f"{where}: {key!r} is not read; give the turn against the clock as 'turn_deg'")
    refuse_unknown(entry, (*TAG_KEYS, *ANGLES), where)
    if "centre" in entry and "center" in entry:
        raise InputError(f"{where}: 'centre' and 'center' say the same; keep one")
    size = float(numbers(entry.get("size"), (), f"{where}: size"))
    if not 0.005 <= size <= 0.5:
        raise InputError(f"{where}: size {size:g} m; it must be 0.005 to 0.5 (the black square, in metres)")
    x, y = numbers(entry.get("centre", entry.get("center", [0, 0])), (2,), f"{where}: centre").tolist()
    turn = float(numbers(entry.get("turn_deg", 0), (), f"{where}: turn_deg"))
    return Tag(_whole(entry.get("id"), f"{where}: id"), size, (x, y), float(np.deg2rad(turn)))


def _whole(value: Any, where: str) -> int:
    number = float(numbers(value, (), where))
    if number != round(number) or number < 0:
        raise InputError(f"{where}: {number:g}; it must be a whole number")
    return round(number)


def _dictionary(data: dict[str, Any], standard: str, file: Path) -> str:
    name = data.get("dictionary", standard)
    if not isinstance(name, str):
        raise InputError(f"{file}: dictionary must be a name, e.g. {standard}")
    return name


def _is_object(entry: Any) -> bool:
    return isinstance(entry, dict)
