"""A surface to a prediction of grasps: the head is asked in every pose in which the scene means the same."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from scipy.special import expit
from torch import Tensor

from neugrasp.detection.decode import Prediction
from neugrasp.geometry.fusion import Grid
from neugrasp.geometry.symmetry import SYMMETRIES, Symmetry
from neugrasp.model.grasp_head import GraspVolume, half_turned, unit


@torch.no_grad()
def predict_grasps(
    head: Callable[[Tensor], GraspVolume],
    tsdf: Grid,
    device: str | torch.device = "cpu",
    symmetries: tuple[Symmetry, ...] = SYMMETRIES,
) -> Prediction:
    """What `head` says of a TSDF in [-1, 1]: the mean of its answers for the grid in eight poses.

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

    def moved_back(grids: np.ndarray) -> np.ndarray:
        return np.stack([one.of_grid(grid) for one, grid in zip(undo, grids, strict=True)])

    there = zip(undo, moved_back(rotations), strict=True)
    turned = np.stack([one.of_rotations(quaternions) for one, quaternions in there])
    rotation = _mean_rotation(torch.from_numpy(turned)).movedim(-1, 0).numpy()
    return Prediction(
        np.asarray(tsdf, dtype=np.float32),
        expit(moved_back(logits).mean(axis=0)).astype(np.float32),
        np.ascontiguousarray(rotation, dtype=np.float32),
        moved_back(widths).mean(axis=0).astype(np.float32),
    )


def _mean_rotation(quaternions: Tensor) -> Tensor:
    """The mean (..., 4) of the orientations (n, ..., 4) of a grasp, about the first of them."""
    first = quaternions[0]
    others = half_turned(quaternions)
    along, across = ((each * first).sum(-1, keepdim=True) for each in (quaternions, others))
    nearer = torch.where(along.abs() >= across.abs(), along.sign() * quaternions, across.sign() * others)
    return unit(nearer.sum(0), dim=-1)
