"""One picture of what the network makes of a validation scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image as PilImage

from neugrasp.change_mask import OBJECT, TABLE
from neugrasp.observation import Image
from neugrasp.pictures.sheet import Tile, contact_sheet
from neugrasp.pictures.slices import busiest_slice, slice_picture
from neugrasp.training.samples import Sample
from neugrasp.training.validation import SurfaceNetwork, reconstruct, render_view

TILE = 320
"""Edge of one picture, pixels."""


def save_progress_picture(path: Path, model: SurfaceNetwork, sample: Sample, sharpness: float) -> None:
    """A held-out view as photographed, as rendered and with what changed in it; true and predicted slices.

    Where the run has no target views, without the first three; where the surface is not known, without it.
    """
    reconstruction, volume = reconstruct(model, sample)
    workspace = model.workspace
    tsdf = reconstruction.tsdf.cpu().numpy()
    truth = None if sample.truth.tsdf is None else sample.truth.tsdf.numpy()
    slice_at = busiest_slice(tsdf if truth is None else truth, workspace)
    quality = np.rot90(volume.quality[0].max(dim=1).values.cpu().numpy())
    tiles = []
    if len(sample.targets.changes):
        image, photo = render_view(model, reconstruction, sample.targets, 0, sharpness)
        tiles = [
            Tile(_bytes(photo), "held-out photo"),
            Tile(_bytes(image), "rendered"),
            Tile(_changes(sample.targets.changes[0].numpy()), "object white, unsure grey"),
        ]
    if truth is not None:
        tiles.append(Tile(slice_picture(truth, workspace, index=slice_at, size=TILE), "true TSDF"))
    tiles += [
        Tile(slice_picture(tsdf, workspace, index=slice_at, size=TILE), "predicted TSDF"),
        Tile(_bytes(np.repeat(quality[..., None], 3, axis=2)), "best grasp quality, from the side"),
    ]
    PilImage.fromarray(contact_sheet(tiles, columns=3)).save(path)


def _bytes(image: np.ndarray) -> Image:
    values = (np.clip(image, 0, 1) * 255).astype(np.uint8)
    return np.asarray(PilImage.fromarray(values).resize((TILE, TILE), PilImage.Resampling.NEAREST))


def _changes(labels: np.ndarray) -> Image:
    grey = np.where(labels == OBJECT, 1.0, np.where(labels == TABLE, 0.0, 0.5))
    return _bytes(np.repeat(grey[..., None], 3, axis=2))
