"""Several pictures with captions on one sheet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from neugrasp.observation import Image

MARGIN = 12
TEXT_SIZE = 18
PAPER = (255, 255, 255)
INK = (30, 30, 30)


@dataclass(frozen=True)
class Tile:
    """A picture with the line of text under it."""

    image: Image
    caption: str


def contact_sheet(tiles: Sequence[Tile], columns: int, title: str = "", legend: Image | None = None) -> Image:
    """The tiles row by row, `columns` in a row, each as large as the largest tile; a legend below them."""
    cell_width = max(tile.image.shape[1] for tile in tiles)
    cell_height = max(tile.image.shape[0] for tile in tiles) + 2 * TEXT_SIZE
    rows = -(-len(tiles) // columns)
    top = MARGIN + (2 * TEXT_SIZE if title else 0)
    size = (
        MARGIN + columns * (cell_width + MARGIN),
        top + rows * (cell_height + MARGIN) + (0 if legend is None else legend.shape[0]),
    )
    sheet = Picture.new("RGB", size, PAPER)
    pen = ImageDraw.Draw(sheet)
    if title:
        pen.text((MARGIN, MARGIN), title, fill=INK, font=ImageFont.load_default(TEXT_SIZE + 4))
    font = ImageFont.load_default(TEXT_SIZE)
    for i, tile in enumerate(tiles):
        left = MARGIN + (i % columns) * (cell_width + MARGIN)
        upper = top + (i // columns) * (cell_height + MARGIN)
        sheet.paste(Picture.fromarray(tile.image), (left, upper))
        pen.text((left, upper + tile.image.shape[0] + 6), tile.caption, fill=INK, font=font)
    if legend is not None:
        sheet.paste(Picture.fromarray(legend), (MARGIN, size[1] - legend.shape[0]))
    return np.asarray(sheet)
