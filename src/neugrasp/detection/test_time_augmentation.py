"""A surface to a prediction of grasps: the head is asked in every pose in which the scene means the same."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float32, Int64
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
    undo = [symmetry.inverse for symmetry in symmetries]

    def mean(grids: Tensor) -> Grid:
        """Of grids in all poses, in the first."""
        each = zip(undo, grids.float().cpu().numpy(), strict=True)
        return np.mean([one.of_grid(grid) for one, grid in each], axis=0, dtype=np.float32)

    def rotations(voxels: Int64[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 4"]:
        flat = np.ravel_multi_index(tuple(voxels.T), tsdf.shape)
        places = np.arange(tsdf.size, dtype=np.int32).reshape(tsdf.shape)
        turned = []
        for one, quaternions in zip(undo, volume.rotation.flatten(2), strict=True):
            there = torch.from_numpy(one.of_grid(places).ravel()[flat]).to(quaternions.device)
            turned.append(one.of_rotations(quaternions[:, there].T.float().cpu().numpy()))
        return _mean_rotation(torch.from_numpy(np.stack(turned))).float().numpy()

    quality = expit(mean(volume.logits))
    return Prediction(np.asarray(tsdf, dtype=np.float32), quality, mean(volume.width), rotations)


def _mean_rotation(quaternions: Tensor) -> Tensor:
    """The mean (..., 4) of the orientations (n, ..., 4) of a grasp, about the first of them."""
    first = quaternions[0]
    others = half_turned(quaternions)
    along, across = ((each * first).sum(-1, keepdim=True) for each in (quaternions, others))
    nearer = torch.where(along.abs() >= across.abs(), along.sign() * quaternions, across.sign() * others)
    return unit(nearer.sum(0), dim=-1)
