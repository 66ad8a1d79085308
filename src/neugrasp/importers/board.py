"""A printed board as data: where its corners are, and where the cube lies beside it.

The board's frame: origin at the lower left corner of the print, x along its lower edge, y up the sheet, z out
of the paper. Lying on the table, z points up.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.camera_checks import numbers
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, apply, rigid, rotation_about
from neugrasp.geometry.workspace import Workspace
from neugrasp.importers.files import pose_of, read_object

GAP = 0.02
"""Metres between the board and the cube where nothing else is said: paper is not gripped."""


@dataclass(frozen=True)
class Charuco:
    """A chessboard with markers in its white squares. The default fits on A4 and on US Letter."""

    columns: int = 7
    rows: int = 5
    square: float = 0.036
    """Metres; measure it on the print."""
    marker: float = 0.027
    """Metres."""
    dictionary: str = "DICT_4X4_50"

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the print in metres."""
        return self.columns * self.square, self.rows * self.square


@dataclass(frozen=True)
class Tag:
    """One marker on the table."""

    number: int
    corners: Array
    """(4, 3) in the board's frame, metres, from the upper left of the upright tag on clockwise."""


@dataclass(frozen=True)
class Tags:
    """Separate markers, e.g. AprilTags, at known places in one plane."""

    tags: tuple[Tag, ...]
    dictionary: str = "DICT_APRILTAG_36h11"

    @property
    def size(self) -> tuple[float, float]:
        """How far the tags reach in x and in y, metres."""
        reach = np.concatenate([tag.corners for tag in self.tags]).max(axis=0)
        return float(reach[0]), float(reach[1])


@dataclass(frozen=True)
class Board:
    """What is printed and where the cube is."""

    print: Charuco | Tags = field(default_factory=Charuco)
    board_from_workspace: Array | None = None
    """None: behind the upper edge of the board, in the middle, standing on the board's plane."""

    def workspace(self) -> Workspace:
        """The cube in a world that is the board's frame."""
        workspace = Workspace()
        if self.board_from_workspace is not None:
            return Workspace(world_from_workspace=self.board_from_workspace)
        width, height = self.print.size
        place = ((width - workspace.size) / 2, height + GAP, -workspace.table_height)
        return Workspace(world_from_workspace=rigid(translation=place))


def read_board(name: str) -> Board:
    """The board of a file, or the one called `default`. Raises `InputError` naming file and field.

    `{"kind": "charuco", "columns": 7, "rows": 5, "square": 0.036, "marker": 0.027,
    "dictionary": "DICT_4X4_50"}` or `{"kind": "tags", "dictionary": "DICT_APRILTAG_36h11",
    "tags": [{"id": 0, "size": 0.05, "centre": [x, y], "turn_deg": 0}]}`, either with `board_from_workspace`.
    """
    if name == "default":
        return Board()
    file = Path(name)
    data = read_object(file)
    kind = data.get("kind")
    if kind not in ("charuco", "tags"):
        raise InputError(f"{file}: kind is {kind!r}; it must be 'charuco' or 'tags'")
    place = data.get("board_from_workspace")
    pose = None if place is None else pose_of(place, f"{file}: board_from_workspace")
    return Board(_charuco(data, file) if kind == "charuco" else _tags(data, file), pose)


def _charuco(data: dict[str, Any], file: Path) -> Charuco:
    standard = Charuco()

    def value(key: str) -> float:
        return float(numbers(data.get(key, getattr(standard, key)), (), f"{file}: {key}"))

    if not isinstance(data.get("dictionary", ""), str):
        raise InputError(f"{file}: dictionary must be a name, e.g. {standard.dictionary}")

    board = Charuco(
        round(value("columns")),
        round(value("rows")),
        value("square"),
        value("marker"),
        str(data.get("dictionary", standard.dictionary)),
    )
    if not (board.columns >= 3 and board.rows >= 3 and 0.005 <= board.marker < board.square <= 0.2):
        raise InputError(
            f"{file}: needs 3 columns and rows at least, and 0.005 m <= marker < square <= 0.2 m (metres!)"
        )
    return board


def _tags(data: dict[str, Any], file: Path) -> Tags:
    entries = data.get("tags")
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{file}: 'tags' must be a list of at least one tag")
    tags = []
    for i, entry in enumerate(entries):
        where = f"{file}, tag {i}"
        if not isinstance(entry, dict):
            raise InputError(f"{where}: must be an object with id, size, centre")
        number = round(float(numbers(entry.get("id"), (), f"{where}: id")))
        size = float(numbers(entry.get("size"), (), f"{where}: size"))
        if not 0.005 <= size <= 0.5:
            raise InputError(
                f"{where}: size {size:g} m; it must be 0.005 to 0.5 (the black square, in metres)"
            )
        centre = numbers(entry.get("centre", [0, 0]), (2,), f"{where}: centre")
        turn = np.deg2rad(float(numbers(entry.get("turn_deg", 0), (), f"{where}: turn_deg")))
        square = size / 2 * np.array([(-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)])
        board_from_tag = rigid(rotation_about((0, 0, 1), turn), (*centre, 0.0))
        tags.append(Tag(number, apply(board_from_tag, square)))
    return Tags(tuple(tags), str(data.get("dictionary", "DICT_APRILTAG_36h11")))
