"""The page to print: the board in its true size, and a ruler to check that the printer did not scale."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from neugrasp.errors import InputError
from neugrasp.importers.board import Board, Charuco
from neugrasp.importers.board_file import read_board
from neugrasp.importers.command import PrintBoard
from neugrasp.importers.markers import picture_of
from neugrasp.observation import Image
from neugrasp.output import whole_file
from neugrasp.terminal import next_step

Paper = Literal["a4", "letter", "a3"]
PAPERS: dict[Paper, tuple[float, float]] = {
    "a4": (0.297, 0.210),
    "letter": (0.2794, 0.2159),
    "a3": (0.420, 0.297),
}
"""Width and height on its side, metres."""
DOTS_PER_METRE = round(300 / 0.0254)
MARGIN = 0.010
"""White around the print, metres: it is needed to find the markers."""
FOOT = 0.005
"""Metres between the lower edge of the page and the ruler."""
RULER = 0.100


def write_sheet(file: Path, board: Board, paper: Paper, inputs: Iterable[Path] = ()) -> None:
    """The page as PDF or PNG by the file's suffix, 300 dots per inch, whole or not at all.

    Raises `InputError`, also where it would be written over one of the `inputs`.
    """
    if file.suffix.lower() not in (".pdf", ".png"):
        raise InputError(f"{file}: the page is written as .pdf or .png")
    page = Picture.fromarray(sheet(board, paper))
    dots_per_inch = DOTS_PER_METRE * 0.0254
    with whole_file(file, inputs) as part:
        if file.suffix.lower() == ".pdf":
            page.convert("L").save(part, resolution=dots_per_inch)
        else:
            page.save(part, dpi=(dots_per_inch, dots_per_inch))


def run(config: PrintBoard) -> str:
    """`neugrasp board`: the file's name and how to print it."""
    board = [] if config.board == "default" else ["--board", config.board]
    write_sheet(config.out, read_board(config.board), config.paper, map(Path, board[1:]))
    return (
        f"{config.out}: print at 100 % (not: fit to page), then measure the line of 100 mm and take photos "
        f"of the table with it\n{next_step('import', 'board', 'PHOTOS', *board, '--out', 'my_scene')}"
    )


def sheet(board: Board, paper: Paper) -> Image:
    """The page as pixels. Raises `InputError` where the board is larger than the paper."""
    width, height = PAPERS[paper]
    board_width, board_height = board.print.size
    if board_width + 2 * MARGIN > width or board_height + 2 * MARGIN > height:
        raise InputError(
            f"the board of {board_width * 1000:.0f} x {board_height * 1000:.0f} mm does not fit on {paper} "
            f"with {MARGIN * 1000:.0f} mm around it; take a larger --paper or smaller squares"
        )
    page = np.full((_dots(height), _dots(width), 3), 255, dtype=np.uint8)
    picture = picture_of(board, DOTS_PER_METRE)
    top, left = ((whole - part) // 2 for whole, part in zip(page.shape, picture.shape[:2], strict=False))
    page[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return _with_ruler(page, left, _words(board))


def _with_ruler(page: Image, left: int, words: str) -> Image:
    """The page with a line of 100 mm and a few words below the board."""
    picture = Picture.fromarray(page)
    draw = ImageDraw.Draw(picture)
    y, right, tick = page.shape[0] - _dots(FOOT), left + _dots(RULER), _dots(0.002)
    draw.line([(left, y), (right, y)], fill="black", width=4)
    for x in (left, right):
        draw.line([(x, y - tick), (x, y)], fill="black", width=4)
    font = ImageFont.load_default(size=_dots(0.0028))
    draw.text((right + _dots(0.004), y), words, fill="black", font=font, anchor="ls")
    return np.asarray(picture)


def _words(board: Board) -> str:
    words = "Print at 100 %: this line is 100 mm long."
    if isinstance(board.print, Charuco):
        words += f" Squares of {board.print.square * 1000:g} mm. This edge faces the camera."
    return words


def _dots(metres: float) -> int:
    return round(metres * DOTS_PER_METRE)
