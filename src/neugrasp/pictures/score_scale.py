"""One colour for each score, the same in every picture, with the legend that says so."""

from __future__ import annotations

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from neugrasp.observation import Image

Colour = tuple[int, int, int]

WORST: Colour = (222, 62, 48)
MIDDLE: Colour = (245, 190, 50)
BEST: Colour = (38, 176, 86)
LOWEST = 0.5
"""The score that is red, with all below; 1 is green."""
TICKS = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
INK, PAPER = (30, 30, 30), (255, 255, 255)
TEXT_SIZE = 14


def colour_of_score(score: float) -> Colour:
    """From red at 0.5 and below over yellow at 0.75 to green at 1, whatever the other scores are."""
    place = float(np.clip((score - LOWEST) / (1 - LOWEST), 0, 1))
    first, second, share = (WORST, MIDDLE, 2 * place) if place < 0.5 else (MIDDLE, BEST, 2 * place - 1)
    mixed = np.array(first) + (np.array(second) - np.array(first)) * share
    red, green, blue = mixed.round().astype(int).tolist()
    return red, green, blue


def colour_of_outcome(held: bool) -> Colour:
    """Green for a grasp that held, red for one that did not."""
    return BEST if held else WORST


def score_legend(width: int = 320) -> Image:
    """A bar of the colours with their scores below, (44, width, 3)."""
    picture = Picture.new("RGB", (width, 44), PAPER)
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(TEXT_SIZE)
    left, right = 60, width - 22
    pen.text((0, 3), "score", fill=INK, font=font)
    for x in range(left, right + 1):
        score = LOWEST + (1 - LOWEST) * (x - left) / (right - left)
        pen.line((x, 4, x, 20), fill=colour_of_score(score))
    for tick in TICKS:
        at = left + (right - left) * (tick - LOWEST) / (1 - LOWEST)
        pen.line((at, 20, at, 24), fill=INK)
        pen.text((at, 26), f"{tick:.1f}", fill=INK, font=font, anchor="ma")
    return np.asarray(picture)
