"""Depth before and after, beside the photo and the truth."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from neugrasp.baselines.swindr.network import Restored
from neugrasp.observation import Image
from neugrasp.pictures.sheet import Tile, contact_sheet
from neugrasp.training.samples import Photos

WRONG = 0.02
"""Metres of error that are drawn as fully red."""


def restoration_picture(photos: Photos, found: Restored) -> Image:
    """A row for each view: photo, measured, restored and true depth, and the error before and after.

    Depth runs from near (bright) to far (dark), black where there is none; errors from none (white) to 2 cm.
    """
    assert photos.depths is not None
    assert photos.sensor is not None
    measured, truth = photos.sensor.measured, photos.depths
    low, high = (float(torch.quantile(truth[truth > 0], part)) for part in (0.01, 0.99))
    tiles = []
    for i, image in enumerate(photos.views.images):
        photo = (image.permute(1, 2, 0).clamp(0, 1) * 255).byte().cpu().numpy()
        named = (("measured", measured[i]), ("restored", found.depth[i]), ("true", truth[i]))
        tiles += [Tile(photo, "photo"), *(Tile(_depth(depth, low, high), name) for name, depth in named)]
        tiles += [Tile(_error(depth, truth[i]), f"error, {name}") for name, depth in named[:2]]
    return contact_sheet(tiles, columns=6)


def _depth(depth: Tensor, low: float, high: float) -> Image:
    grey = (1 - (depth - low) / (high - low)).clamp(0, 1) * 0.9 + 0.1
    return _bytes(torch.where(depth > 0, grey, 0)[..., None].expand(-1, -1, 3))


def _error(depth: Tensor, truth: Tensor) -> Image:
    wrong = ((depth - truth).abs() / WRONG).clamp(0, 1)[..., None]
    colour = 1 - wrong * (1 - wrong.new_tensor([0.8, 0.1, 0.1]))
    return _bytes(torch.where(((depth > 0) & (truth > 0))[..., None], colour, 0))


def _bytes(image: Tensor) -> Image:
    values: Image = (image * 255).byte().cpu().numpy()
    return np.ascontiguousarray(values)
