"""TSDF grid -> quality, rotation and width at every voxel (VGN's convolutional network)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

from neugrasp.model.config import ModelConfig


@dataclass(frozen=True)
class GraspVolume:
    """Predictions at the voxels of grids."""

    quality: Float[Tensor, "grids r r r"]
    """Probability that a grasp at this voxel succeeds."""
    rotation: Float[Tensor, "grids 4 r r r"]
    """Unit quaternion (x, y, z, w), workspace_from_grasp."""
    width: Float[Tensor, "grids r r r"]
    """Opening in voxels."""
    logits: Float[Tensor, "grids r r r"]
    """Logits of the quality, for a loss that does not saturate."""


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

    def forward(self, tsdf: Float[Tensor, "grids r r r"]) -> GraspVolume:
        """From grids with values in [-1, 1]; r a multiple of 8."""
        x = tsdf.unsqueeze(1)
        for convolution in self.encoder:
            x = F.relu(convolution(x))
        first, *doubling = self.decoder
        x = F.relu(first(x))
        for convolution in doubling:
            x = F.relu(convolve_doubled(x, convolution))
        outputs = convolve_doubled(x, self.quality, self.rotation, self.width)
        logits, rotation, width = outputs.split([1, 4, 1], dim=1)
        logits = logits.squeeze(1)
        return GraspVolume(torch.sigmoid(logits), unit(rotation, dim=1), width.squeeze(1), logits)


def unit(x: Float[Tensor, "*shape"], dim: int) -> Float[Tensor, "*shape"]:
    """Vectors of length 1; a thirteenth of the time that `F.normalize` takes along a short axis on a CPU."""
    return x * (x * x).sum(dim, keepdim=True).clamp(min=1e-24).rsqrt()


def half_turned(quaternions: Float[Tensor, "*grasps 4"]) -> Float[Tensor, "*grasps 4"]:
    """Orientations, xyzw, turned by pi about their own approach: the same grasps."""
    x, y, z, w = quaternions.unbind(-1)
    return torch.stack([y, -x, w, -z], dim=-1)


def convolve_doubled(
    x: Float[Tensor, "grids channels x y z"], *layers: nn.Module
) -> Float[Tensor, "grids out 2*x 2*y 2*z"]:
    """Convolutions of x upsampled by two to the nearest voxel.

    Voxels next to each other are equal there, so their weights (o, c, k, k, k) add up: 3 x 3 x 3 remain
    for each of the 8 places in a coarse voxel. With k = 5 that is a fifth of the products.
    """
    weight = torch.cat([layer.get_parameter("weight") for layer in layers])
    bias = torch.cat([layer.get_parameter("bias") for layer in layers])
    reach = weight.shape[-1] // 2
    taps = torch.arange(-reach, reach + 1, device=x.device)
    coarse = torch.stack([(side + taps).div(2, rounding_mode="floor") for side in (0, 1)])
    sums = (coarse.unsqueeze(1) == torch.arange(-1, 2, device=x.device).unsqueeze(1)).to(weight)
    weight = torch.einsum("ocijk,xai,ybj,zdk->oxyzcabd", weight, sums, sums, sums)
    out = F.conv3d(x, weight.flatten(0, 3), bias.repeat_interleave(8), padding=1)
    return rearrange(out, "b (o i j k) x y z -> b o (x i) (y j) (z k)", i=2, j=2, k=2)
