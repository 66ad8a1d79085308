"""A surface to a prediction of grasps: the head is asked in every pose in which the scene means the same."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from scipy.special import expit
from torch import Tensor

from neugrasp.detection.decode import Grid, Prediction
from neugrasp.geometry.symmetry import SYMMETRIES, Symmetry
from neugrasp.model.grasp_head import GraspVolume


@torch.no_grad()
def predict_grasps(
    head: Callable[[Tensor], GraspVolume],
    tsdf: Grid,
    device: str | torch.device = "cpu",
    symmetries: tuple[Symmetry, ...] = SYMMETRIES,
) -> Prediction:
    """What `head` says of a TSDF (r, r, r) in [-1, 1]: the mean of its answers for the grid in eight poses.

    Nothing in a scene tells these poses apart, but a convolution does: its errors differ from pose to pose,
    and most of them cancel. The means are of logits, of widths, and of rotations about the first pose's, each
    as itself or turned by pi about the approach, which is the same grasp.
    """
    poses = np.stack([symmetry.of_grid(tsdf) for symmetry in symmetries])
    volume = head(torch.from_numpy(poses).float().to(device))
    logits, widths, rotations = (
        each.float().cpu().numpy() for each in (volume.logits, volume.width, volume.rotation.movedim(1, -1))
    )
    undo = [symmetry.inverse for symmetry in symmetries]
    logit = np.mean([one.of_grid(grid) for one, grid in zip(undo, logits, strict=True)], axis=0)
    width = np.mean([one.of_grid(grid) for one, grid in zip(undo, widths, strict=True)], axis=0)
    turned = [one.of_rotations(one.of_grid(grid)) for one, grid in zip(undo, rotations, strict=True)]
    rotation = np.moveaxis(_mean_rotation(turned), -1, 0)
    return Prediction(
        np.asarray(tsdf, dtype=np.float32),
        expit(logit).astype(np.float32),
        rotation.astype(np.float32),
        width.astype(np.float32),
    )


def _mean_rotation(quaternions: list[np.ndarray]) -> np.ndarray:
    """The mean (..., 4) of grasps' orientations about the first of them."""
    first = quaternions[0]
    total = np.zeros_like(first)
    for one in quaternions:
        x, y, z, w = np.moveaxis(one, -1, 0)
        other = np.stack([y, -x, w, -z], axis=-1)  # Turned by pi about the approach.
        along, across = (np.sum(each * first, axis=-1, keepdims=True) for each in (one, other))
        total += np.where(np.abs(along) >= np.abs(across), np.sign(along) * one, np.sign(across) * other)
    return total / np.maximum(np.linalg.norm(total, axis=-1, keepdims=True), 1e-9)
