"""Photos -> feature maps: a Res U-Net shared by scene and background, and the residual against it."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from neugrasp.model.config import ModelConfig


def conv3x3(channels_in: int, channels_out: int, stride: int = 1) -> nn.Conv2d:
    """A bias-free 3 x 3 convolution with reflected borders."""
    return nn.Conv2d(channels_in, channels_out, 3, stride, 1, bias=False, padding_mode="reflect")


def norm(channels: int) -> nn.InstanceNorm2d:
    """Instance normalisation with learned scale; it keeps no statistics, so one photo is enough."""
    return nn.InstanceNorm2d(channels, affine=True)


class ResidualBlock(nn.Module):
    """Two 3 x 3 convolutions and a short cut."""

    def __init__(self, channels_in: int, channels_out: int, stride: int):
        super().__init__()
        self.body = nn.Sequential(
            conv3x3(channels_in, channels_out, stride),
            norm(channels_out),
            nn.ReLU(),
            conv3x3(channels_out, channels_out),
            norm(channels_out),
        )
        self.shortcut: nn.Module = nn.Identity()
        if stride != 1 or channels_in != channels_out:
            self.shortcut = nn.Sequential(
                nn.Conv2d(channels_in, channels_out, 1, stride, bias=False), norm(channels_out)
            )

    def forward(self, x: Tensor) -> Tensor:
        """(n, channels_in, h, w) to (n, channels_out, h / stride, w / stride)."""
        return F.relu(self.body(x) + self.shortcut(x))


def _stage(channels_in: int, channels_out: int, blocks: int) -> nn.Sequential:
    first = ResidualBlock(channels_in, channels_out, stride=2)
    rest = [ResidualBlock(channels_out, channels_out, stride=1) for _ in range(blocks - 1)]
    return nn.Sequential(first, *rest)


def _fuse(channels_in: int, channels_out: int) -> nn.Sequential:
    return nn.Sequential(conv3x3(channels_in, channels_out), norm(channels_out), nn.ELU())


class FeatureNet(nn.Module):
    """The Res U-Net: RGB (n, 3, h, w) in [0, 1] to features (n, feature_dim, h / 4, w / 4)."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        first, second, third = (config.encoder_width * k for k in (1, 2, 4))
        blocks = config.encoder_blocks
        self.stem = nn.Sequential(
            nn.Conv2d(3, first, 7, 2, 3, bias=False, padding_mode="reflect"), norm(first), nn.ReLU()
        )
        self.stage1 = _stage(first, first, blocks[0])
        self.stage2 = _stage(first, second, blocks[1])
        self.stage3 = _stage(second, third, blocks[2])
        self.up2 = _fuse(third, second)
        self.join2 = _fuse(2 * second, second)
        self.up1 = _fuse(second, first)
        self.join1 = _fuse(2 * first, first)
        self.out = nn.Conv2d(first, config.feature_dim, 1)

    def forward(self, images: Tensor) -> Tensor:
        """Feature maps at a quarter of the images' resolution."""
        quarter = self.stage1(self.stem(images))
        eighth = self.stage2(quarter)
        x = self.stage3(eighth)
        x = self.join2(torch.cat([self.up2(_double(x)), eighth], dim=1))
        x = self.join1(torch.cat([self.up1(_double(x)), quarter], dim=1))
        return self.out(x)


def _double(x: Tensor) -> Tensor:
    return F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)


class ResidualAttention(nn.Module):
    """Eq. 7: scene features gated by how they differ from the background's, pixel by pixel."""

    def __init__(self, dim: int):
        super().__init__()
        self.query = nn.Conv2d(dim, dim, 1, bias=False)
        self.key = nn.Conv2d(dim, dim, 1, bias=False)
        self.value = nn.Conv2d(dim, dim, 1, bias=False)
        self.gate = nn.Sequential(nn.Conv2d(dim, dim // 2, 1), nn.ReLU(), nn.Conv2d(dim // 2, dim, 1))
        self.out = nn.Conv2d(dim, dim, 1)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight)

    def forward(self, scene: Tensor, background: Tensor) -> Tensor:
        """Foreground-attentive features, same shape as both inputs (n, d, h, w)."""
        key = self.key(scene)
        gate = torch.sigmoid(self.gate(key - self.query(background)))
        return self.out(self.value(key) * gate)
