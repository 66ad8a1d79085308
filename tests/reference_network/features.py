"""Photos -> feature maps (method of `model/features.py`), layer by layer."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from neugrasp.model.config import ModelConfig


def _conv3x3(channels_in: int, channels_out: int, stride: int = 1) -> nn.Conv2d:
    return nn.Conv2d(channels_in, channels_out, 3, stride, 1, bias=False, padding_mode="reflect")


def _norm(channels: int) -> nn.InstanceNorm2d:
    return nn.InstanceNorm2d(channels, affine=True)


class _Block(nn.Module):
    def __init__(self, channels_in: int, channels_out: int, stride: int):
        super().__init__()
        self.body = nn.Sequential(
            _conv3x3(channels_in, channels_out, stride),
            _norm(channels_out),
            nn.ReLU(),
            _conv3x3(channels_out, channels_out),
            _norm(channels_out),
        )
        self.shortcut: nn.Module = nn.Identity()
        if stride != 1 or channels_in != channels_out:
            convolution = nn.Conv2d(channels_in, channels_out, 1, stride, bias=False)
            self.shortcut = nn.Sequential(convolution, _norm(channels_out))

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(self.body(x) + self.shortcut(x))


def _stage(channels_in: int, channels_out: int, blocks: int) -> nn.Sequential:
    rest = [_Block(channels_out, channels_out, 1) for _ in range(blocks - 1)]
    return nn.Sequential(_Block(channels_in, channels_out, 2), *rest)


def _fuse(channels_in: int, channels_out: int) -> nn.Sequential:
    return nn.Sequential(_conv3x3(channels_in, channels_out), _norm(channels_out), nn.ELU())


class PlainFeatures(nn.Module):
    """The Res U-Net: RGB (n, 3, h, w) to features (n, feature_dim, h / 4, w / 4)."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        first, second, third = (config.encoder_width * k for k in (1, 2, 4))
        blocks = config.encoder_blocks
        enter = nn.Conv2d(3, first, 7, 2, 3, bias=False, padding_mode="reflect")
        self.stem = nn.Sequential(enter, _norm(first), nn.ReLU())
        self.stage1 = _stage(first, first, blocks[0])
        self.stage2 = _stage(first, second, blocks[1])
        self.stage3 = _stage(second, third, blocks[2])
        self.up2 = _fuse(third, second)
        self.join2 = _fuse(2 * second, second)
        self.up1 = _fuse(second, first)
        self.join1 = _fuse(2 * first, first)
        self.out = nn.Conv2d(first, config.feature_dim, 1)

    def forward(self, images: Tensor) -> Tensor:
        quarter = self.stage1(self.stem(images))
        eighth = self.stage2(quarter)
        x = self.up2(self._double(self.stage3(eighth)))
        x = self.up1(self._double(self.join2(torch.cat([x, eighth], dim=1))))
        features: Tensor = self.out(self.join1(torch.cat([x, quarter], dim=1)))
        return features

    def _double(self, x: Tensor) -> Tensor:
        return F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)


class PlainResidual(nn.Module):
    """Eq. 7: scene features (n, d, h, w) gated by how they differ from the background's."""

    def __init__(self, dim: int):
        super().__init__()
        self.query = nn.Conv2d(dim, dim, 1, bias=False)
        self.key = nn.Conv2d(dim, dim, 1, bias=False)
        self.value = nn.Conv2d(dim, dim, 1, bias=False)
        self.gate = nn.Sequential(nn.Conv2d(dim, dim // 2, 1), nn.ReLU(), nn.Conv2d(dim // 2, dim, 1))
        self.out = nn.Conv2d(dim, dim, 1)

    def forward(self, scene: Tensor, background: Tensor) -> Tensor:
        key = self.key(scene)
        gate = torch.sigmoid(self.gate(key - self.query(background)))
        attended: Tensor = self.out(self.value(key) * gate)
        return attended
