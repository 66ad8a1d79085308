"""Feature maps -> prior volumes (method of `model/volumes.py`), layer by layer."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from neugrasp.model.config import ModelConfig


def _block(channels_in: int, channels_out: int, stride: int = 1) -> nn.Sequential:
    convolution = nn.Conv3d(channels_in, channels_out, 3, stride, 1, bias=False)
    return nn.Sequential(convolution, nn.GroupNorm(max(1, channels_out // 8), channels_out), nn.ReLU())


class _Up(nn.Module):
    def __init__(self, channels_in: int, channels_out: int):
        super().__init__()
        self.body = _block(channels_in, channels_out)

    def forward(self, x: Tensor, skip: Tensor) -> Tensor:
        up: Tensor = self.body(F.interpolate(x, scale_factor=2.0, mode="nearest"))
        return up + skip


class PlainVolumes(nn.Module):
    """Features (n, p, dim) of n views at r^3 voxels, and who sees them (n, p), to (volume_dim, r, r, r)."""

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
        resolution = round(features.shape[1] ** (1 / 3))
        x = self.reduce(features)
        weights = (seen / seen.sum(0, keepdim=True).clamp(min=1)).unsqueeze(-1)
        mean = (weights * x).sum(0)
        variance = (weights * (x - mean).square()).sum(0)
        x0 = torch.cat([mean, variance], dim=1).T.reshape(1, -1, resolution, resolution, resolution)
        x0 = self.enter(x0)
        x1 = self.down1(x0)
        x2 = self.down2(x1)
        x3 = self.down3(x2)
        x = self.up1(self.up2(self.up3(x3, x2), x1), x0)
        volume: Tensor = self.out(x).squeeze(0)
        return volume
