"""Feature maps -> prior volumes: what the views agree on at each voxel, made smooth by a 3D U-Net."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from neugrasp.model.config import ModelConfig


def masked_mean_and_variance(features: Tensor, seen: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and variance (c, p) over the views of features (n, c, p) where `seen` (n, p); 0 where none is."""
    weights = (seen / seen.sum(0, keepdim=True).clamp(min=1)).unsqueeze(1)
    mean = (weights * features).sum(0)
    return mean, (weights * (features - mean).square()).sum(0)


def _block(channels_in: int, channels_out: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv3d(channels_in, channels_out, 3, stride, 1, bias=False),
        nn.GroupNorm(max(1, channels_out // 8), channels_out),
        nn.ReLU(),
    )


class _Up(nn.Module):
    """Doubles the resolution and adds the skip, without the pattern that transposed convolutions print."""

    def __init__(self, channels_in: int, channels_out: int):
        super().__init__()
        self.body = _block(channels_in, channels_out)

    def forward(self, x: Tensor, skip: Tensor) -> Tensor:
        up: Tensor = self.body(F.interpolate(x, scale_factor=2.0, mode="nearest"))
        return up + skip


class VolumeNet(nn.Module):
    """Per-view features at the voxels -> a prior volume (volume_dim, x, y, z).

    The paper's network with group normalisation in place of batch normalisation (a step sees one scene, and
    both priors go through the same weights) and nearest upsampling in place of transposed convolutions.
    """

    def __init__(self, config: ModelConfig):
        super().__init__()
        dim, volume = config.feature_dim, config.volume_dim
        a, b, c, d = config.volume_hidden
        self.reduce = nn.Sequential(
            nn.Linear(dim, dim), nn.ReLU(), nn.Linear(dim, volume), nn.ReLU(), nn.Linear(volume, volume // 2)
        )
        self.enter = _block(2 * (volume // 2), a)
        self.down1 = nn.Sequential(_block(a, b, 2), _block(b, b))
        self.down2 = nn.Sequential(_block(b, c, 2), _block(c, c))
        self.down3 = nn.Sequential(_block(c, d, 2), _block(d, d))
        self.up3, self.up2, self.up1 = _Up(d, c), _Up(c, b), _Up(b, a)
        self.out = nn.Conv3d(a, volume, 3, 1, 1)

    def forward(self, features: Tensor, seen: Tensor) -> Tensor:
        """Volume (c, r, r, r) from features (n, dim, r^3) read at the voxels [x, y, z], and `seen`."""
        resolution = round(features.shape[-1] ** (1 / 3))
        reduced = self.reduce(features.transpose(1, 2)).transpose(1, 2)
        mean, variance = masked_mean_and_variance(reduced, seen.to(reduced.dtype))
        x0 = torch.cat([mean, variance]).reshape(1, -1, resolution, resolution, resolution)
        x0 = self.enter(x0)
        x1 = self.down1(x0)
        x2 = self.down2(x1)
        x3 = self.down3(x2)
        x = self.up1(self.up2(self.up3(x3, x2), x1), x0)
        volume: Tensor = self.out(x).squeeze(0)
        return volume
