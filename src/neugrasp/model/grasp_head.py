"""TSDF grid -> quality, rotation and width at every voxel (VGN's convolutional network)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from neugrasp.model.config import ModelConfig


@dataclass(frozen=True)
class GraspVolume:
    """Predictions at the voxels of b grids."""

    quality: Tensor
    """(b, r, r, r) probability that a grasp at this voxel succeeds."""
    rotation: Tensor
    """(b, 4, r, r, r) unit quaternion (x, y, z, w), workspace_from_grasp."""
    width: Tensor
    """(b, r, r, r) opening in voxels."""
    logits: Tensor
    """(b, r, r, r) of the quality, for a loss that does not saturate."""


def _conv(channels_in: int, channels_out: int, kernel: int, stride: int = 1) -> nn.Conv3d:
    return nn.Conv3d(channels_in, channels_out, kernel, stride, kernel // 2)


class GraspHead(nn.Module):
    """Three strided convolutions down to 5 voxels, three up again, and one branch per output."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        a, b, c = config.head_channels
        self.encoder = nn.ModuleList([_conv(1, a, 5, 2), _conv(a, b, 3, 2), _conv(b, c, 3, 2)])
        self.decoder = nn.ModuleList([_conv(c, c, 3), _conv(c, b, 3), _conv(b, a, 5)])
        self.quality = _conv(a, 1, 5)
        self.rotation = _conv(a, 4, 5)
        self.width = _conv(a, 1, 5)

    def forward(self, tsdf: Tensor) -> GraspVolume:
        """From grids (b, r, r, r) with values in [-1, 1]; r a multiple of 8."""
        resolution = tsdf.shape[-1]
        x = tsdf.unsqueeze(1)
        for conv in self.encoder:
            x = F.relu(conv(x))
        for conv, divisor in zip(self.decoder, (4, 2, 1), strict=True):
            x = F.interpolate(F.relu(conv(x)), size=resolution // divisor, mode="nearest")
        logits = self.quality(x).squeeze(1)
        return GraspVolume(
            torch.sigmoid(logits), F.normalize(self.rotation(x), dim=1), self.width(x).squeeze(1), logits
        )
