"""A printed board as data: where its corners are, and where the cube lies beside it.

The board's frame: origin at the lower left corner of the print, x along its lower edge, y up the sheet, z out
of the paper. Lying on the table, z points up.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from neugrasp.geometry.pose import Array, apply, rigid, rotation_about
from neugrasp.geometry.workspace import USUAL, Workspace

GAP = 0.02
"""Metres between the board and the cube where nothing else is said: paper is not gripped."""
Upright = Literal["official", "opencv"]
"""Whose pictures of AprilTags are printed: those of the family, or OpenCV's, which stand on their heads."""


FIRST_TAGS = {
    "DICT_APRILTAG_16H5": 0x231B,
    "DICT_APRILTAG_25H9": 0x155CBF1,
    "DICT_APRILTAG_36H10": 0x1CA92A687,
    "DICT_APRILTAG_36H11": 0xD5D628584,
}
"""Tag 0 of the families of AprilTags in their official pictures: bits by rows from the upper left, 1 is "
"white."""


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
    legacy: bool = False
    """Whether the upper left square is white where the number of rows is even, as OpenCV drew it before "
    "4.6."""

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the print in metres."""
        return self.columns * self.square, self.rows * self.square

    def markers(self) -> Array:
        """Corners (n, 4, 3) of the markers by their numbers, in the board's frame, from the upper left on
        clockwise."""
        starts_white = self.legacy and self.rows % 2 == 0
        places = [
            (column, row)
            for row in range(self.rows)
            for column in range(self.columns)
            if (row + column) % 2 == (0 if starts_white else 1)
        ]
        centres = (np.array(places) + 0.5) * self.square
        middles = np.stack([centres[:, 0], self.size[1] - centres[:, 1]], axis=-1)
        square = self.marker / 2 * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)])
        corners = middles[:, None] + square
        return np.concatenate([corners, np.zeros((*corners.shape[:2], 1))], axis=-1)


@dataclass(frozen=True)
class Tag:
    """One marker on the table."""

    number: int
    size: float
    """Edge of the black square, metres."""
    centre: tuple[float, float] = (0.0, 0.0)
    """In the board's frame, metres."""
    turn: float = 0.0
    """Radians against the clock, seen from above."""

    @property
    def corners(self) -> Array:
        """(4, 3) in the board's frame, metres, from the upper left of the upright tag on clockwise."""
        square = self.size / 2 * np.array([(-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)])
        return apply(rigid(rotation_about((0, 0, 1), self.turn), (*self.centre, 0.0)), square)


@dataclass(frozen=True)
class Tags:
    """Separate markers, e.g. AprilTags, at known places in one plane."""

    tags: tuple[Tag, ...]
    dictionary: str = "DICT_APRILTAG_36h11"
    upright: Upright | None = None
    """How AprilTags stand; None where it was not said."""

    @property
    def size(self) -> tuple[float, float]:
        """How far the tags reach in x and in y, metres."""
        reach = np.concatenate([tag.corners for tag in self.tags]).max(axis=0)
        return float(reach[0]), float(reach[1])

    @property
    def first_picture(self) -> Array | None:
        """Tag 0 of a family of AprilTags as its official picture has it, (n, n) of 0 and 1: it says how a
        library's own pictures are turned. None for other dictionaries, whose pictures are all alike."""
        code = FIRST_TAGS.get(self.dictionary.upper())
        if code is None:
            return None
        side = int(self.dictionary.upper().rsplit("_", 1)[1].split("H")[0]) ** 0.5
        bits = np.array([(code >> place) & 1 for place in reversed(range(round(side) ** 2))])
        return bits.reshape(round(side), round(side)).astype(np.float64)

    @property
    def is_ambiguous(self) -> bool:
        """Whether it is open whose pictures the tags are."""
        return self.upright is None and self.dictionary.upper() in FIRST_TAGS


@dataclass(frozen=True)
class Board:
    """What is printed and where the cube is."""

    print: Charuco | Tags = field(default_factory=Charuco)
    board_from_workspace: Array | None = None
    """None: behind the upper edge of the board, in the middle, standing on the board's plane."""

    def workspace(self) -> Workspace:
        """The cube in a world that is the board's frame."""
        workspace = USUAL
        if self.board_from_workspace is not None:
            return Workspace(world_from_workspace=self.board_from_workspace)
        width, height = self.print.size
        place = ((width - workspace.size) / 2, height + GAP, -workspace.table_height)
        return Workspace(world_from_workspace=rigid(translation=place))

    def drawn(self, upright: Upright) -> Board:
        """The same board where it is known whose pictures its tags are."""
        return (
            replace(self, print=replace(self.print, upright=upright))
            if isinstance(self.print, Tags)
            else self
        )
