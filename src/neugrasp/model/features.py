"""Photos -> feature maps: a Res U-Net shared by scene and background, and the residual against it."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from neugrasp.geometry.sampling import full_precision
from neugrasp.model.config import ModelConfig
from neugrasp.model.initial import fill
from neugrasp.model.norm import GroupNorm

CHANGE_GAIN = 4.0
"""Brings differences of photos to the scale of features."""


class ReflectedConv(nn.Conv2d):
    """A bias-free convolution with reflected borders."""

    def __init__(self, channels_in: int, channels_out: int, kernel: int = 3, stride: int = 1):
        super().__init__(channels_in, channels_out, kernel, stride, bias=False)
        self.border = (kernel // 2,) * 4

    def forward(self, x: Float[Tensor, "images channels height width"]) -> Float[Tensor, "images out _ _"]:
        """The maps, height and width divided by the stride."""
        return super().forward(_reflected(x, self.border))


@full_precision
def _reflected(x: Tensor, border: tuple[int, ...]) -> Tensor:
    """With reflected borders, in the precision that it comes in: autocast would make them float32."""
    return F.pad(x, border, mode="reflect")


class StridedPointwise(nn.Conv2d):
    """A bias-free 1 x 1 convolution of every `step`-th pixel.

    Same result and weights as one with a stride, whose backward pass in oneDNN's AVX2 kernels writes past its
    memory for 4 channels that lie last in memory (8, 12 and 16 are clean; torch 2.13.0).
    """

    def __init__(self, channels_in: int, channels_out: int, step: int):
        super().__init__(channels_in, channels_out, 1, bias=False)
        self.step = step

    def forward(self, x: Float[Tensor, "images channels height width"]) -> Float[Tensor, "images out _ _"]:
        """The maps, height and width divided by the step and rounded up."""
        return super().forward(x[..., :: self.step, :: self.step])


def norm(channels: int) -> GroupNorm:
    """Instance normalisation with learned scale."""
    return GroupNorm(channels, channels)


class ResidualBlock(nn.Module):
    """Two 3 x 3 convolutions and a short cut."""

    def __init__(self, channels_in: int, channels_out: int, stride: int):
        super().__init__()
        self.body = nn.Sequential(
            ReflectedConv(channels_in, channels_out, stride=stride),
            norm(channels_out),
            nn.ReLU(),
            ReflectedConv(channels_out, channels_out),
            norm(channels_out),
        )
        self.shortcut: nn.Module = nn.Identity()
        if stride != 1 or channels_in != channels_out:
            self.shortcut = nn.Sequential(
                StridedPointwise(channels_in, channels_out, stride), norm(channels_out)
            )

    def forward(self, x: Float[Tensor, "images channels height width"]) -> Float[Tensor, "images out _ _"]:
        """The maps, height and width divided by the stride."""
        return F.relu(self.body(x) + self.shortcut(x))


def _stage(channels_in: int, channels_out: int, blocks: int) -> nn.Sequential:
    first = ResidualBlock(channels_in, channels_out, stride=2)
    rest = [ResidualBlock(channels_out, channels_out, stride=1) for _ in range(blocks - 1)]
    return nn.Sequential(first, *rest)


def _fuse(channels_in: int, channels_out: int) -> nn.Sequential:
    return nn.Sequential(ReflectedConv(channels_in, channels_out), norm(channels_out), nn.ELU())


class FeatureNet(nn.Module):
    """The Res U-Net: RGB in [0, 1] to features at a quarter of its resolution."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        first, second, third = (config.encoder_width * k for k in (1, 2, 4))
        blocks = config.encoder_blocks
        self.stem = nn.Sequential(ReflectedConv(3, first, kernel=7, stride=2), norm(first), nn.ReLU())
        self.stage1 = _stage(first, first, blocks[0])
        self.stage2 = _stage(first, second, blocks[1])
        self.stage3 = _stage(second, third, blocks[2])
        self.up2 = _fuse(third, second)
        self.join2 = _fuse(2 * second, second)
        self.up1 = _fuse(second, first)
        self.join1 = _fuse(2 * first, first)
        self.out = nn.Conv2d(first, config.feature_dim, 1)

    def forward(
        self, images: Float[Tensor, "images 3 height width"]
    ) -> Float[Tensor, "images channels height//4 width//4"]:
        """Feature maps; height and width are multiples of 16."""
        quarter = self.stage1(self.stem(images.contiguous(memory_format=torch.channels_last)))
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
                fill(module.weight, nn.init.kaiming_normal_)
        # Where nothing changed the gate sees zeros from the start.
        self.query.weight.data.copy_(self.key.weight.data)

    def forward(
        self,
        scene: Float[Tensor, "views channels height width"],
        background: Float[Tensor, "views channels height width"],
    ) -> Float[Tensor, "views channels height width"]:
        """Foreground-attentive features."""
        key = self.key(scene)
        gate = torch.sigmoid(self.gate(key - self.query(background)))
        return self.out(self.value(key) * gate)


class ImageDifference(nn.Module):
    """What changed against the background, straight from the photos; zero where nothing did.

    The encoder's features differ from the background's everywhere: it normalises over the whole photo, so a
    few objects change those of the table all around them (docs/training_log.md).
    """

    def __init__(self, dim: int):
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(3, dim, 5, 2, 2, bias=False), nn.ReLU(), nn.Conv2d(dim, dim, 5, 2, 2, bias=False)
        )

    def forward(
        self, images: Float[Tensor, "views 3 size size"], backgrounds: Float[Tensor, "views 3 size size"]
    ) -> Float[Tensor, "views channels size//4 size//4"]:
        """Maps of photos in [0, 1]."""
        maps: Tensor = self.layers(CHANGE_GAIN * (images - backgrounds))
        return maps
