"""A photo and what a depth sensor measured -> the depth of every pixel."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from einops import rearrange
from torch import Tensor, nn

from neugrasp.baselines.swindr.config import SwinConfig
from neugrasp.baselines.swindr.swin import Perceptron, Swin, WindowAttention
from neugrasp.geometry.workspace import Workspace

POOLS = (1, 2, 3, 6)
"""Cells along an edge that UPerNet's coarsest maps are averaged over."""
TRUST = 1.5
"""What the logits of the measured and of the initial depth begin with, of either sign."""


@dataclass(frozen=True)
class Restored:
    """Depth images (b, h, w), z in metres."""

    depth: Tensor
    """Depth of every pixel: the measurement where it is trusted, else what the network sees."""
    initial: Tensor
    """What the network sees by itself."""
    trust: Tensor
    """(b, h, w) in [0, 1]: how much of the depth is the measurement; 0 where nothing was measured."""


def restored(measured: Tensor, initial: Tensor, logits: Tensor) -> Restored:
    """Depth between the measured and the initial one, (b, h, w) each, by the logits (b, 2, h, w) of the two.

    Where nothing was measured (0) the initial one alone counts.
    """
    known = measured > 0
    trust = torch.softmax(logits.float(), 1)[:, 0] * known
    return Restored(torch.lerp(initial, torch.where(known, measured, initial), trust), initial, trust)


class Fusion(nn.Module):
    """Two maps learn from one another, and a third from both. Neither comes first."""

    def __init__(self, width: int, window: int):
        super().__init__()
        self.normals = nn.ModuleList(nn.LayerNorm(width) for _ in range(2))
        self.attentions = nn.ModuleList(WindowAttention(width, 1, window) for _ in range(2))
        self.between = nn.ModuleList(nn.LayerNorm(width) for _ in range(2))
        self.perceptrons = nn.ModuleList(Perceptron(width) for _ in range(2))
        self.joined, self.normal = nn.Linear(2 * width, width), nn.LayerNorm(width)

    def forward(self, colour: Tensor, depth: Tensor) -> Tensor:
        """Maps (b, h, w, c) of photo and depth -> (b, h, w, 3 c): both as they came, and what joins them."""
        maps = (colour, depth)
        normal = [one(x) for one, x in zip(self.normals, maps, strict=True)]
        learned = []
        for i, x in enumerate(maps):
            # Asked by the other branch's tokens, about this one's (cross-attention fusion of SwinDRNet).
            y = x + self.attentions[i](normal[1 - i], normal[i])
            learned.append(y + self.perceptrons[i](self.between[i](y)))
        return torch.cat([*maps, self.normal(self.joined(torch.cat(learned, -1)))], -1)


class Decoder(nn.Module):
    """UPerNet (Xiao et al., ECCV 2018): maps of four sizes -> an image four times as large as the first."""

    def __init__(self, widths: list[int], width: int, channels: int):
        super().__init__()
        self.pooled = nn.ModuleList(_layer(widths[-1], width, 1) for _ in POOLS)
        self.top = _layer(widths[-1] + len(POOLS) * width, width)
        self.sideways = nn.ModuleList(_layer(c, width, 1) for c in widths[:-1])
        self.smooth = nn.ModuleList(_layer(width, width) for _ in widths[:-1])
        self.join = _layer(len(widths) * width, width)
        self.out = nn.Conv2d(width, channels, 1)

    def forward(self, maps: list[Tensor]) -> Tensor:
        """(b, c, h, w) each, the largest first -> (b, channels, 4 h, 4 w)."""
        *lower, top = maps
        pools = [
            _resized(layer(F.adaptive_avg_pool2d(top, pool)), top)
            for layer, pool in zip(self.pooled, POOLS, strict=True)
        ]
        found = [self.top(torch.cat([top, *pools], 1))]
        for layer, x in zip(reversed(self.sideways), reversed(lower), strict=True):
            side = layer(x)
            found.insert(0, side + _resized(found[0], side))
        smooth = [layer(x) for layer, x in zip(self.smooth, found, strict=False)]
        joined = self.join(torch.cat([_resized(x, maps[0]) for x in (*smooth, found[-1])], 1))
        return F.interpolate(self.out(joined), scale_factor=4, mode="bilinear", align_corners=False)


class SwinDR(nn.Module):
    """A branch for the photo, one for the depth, met at four scales; decoders of depth and of trust."""

    def __init__(self, config: SwinConfig, workspace: Workspace):
        super().__init__()
        self.config, self.workspace = config, workspace
        sizes = (config.width, config.depths, config.heads, config.window)
        self.colour, self.measured = Swin(3, *sizes), Swin(2, *sizes)
        widths = [config.width * 2**i for i in range(len(config.depths))]
        self.fusions = nn.ModuleList(Fusion(width, config.window) for width in widths)
        fused = [3 * width for width in widths]
        self.depth = Decoder(fused, config.decoder_width, 1)
        self.trust = Decoder(fused, config.decoder_width, 2)
        # It begins with the measurement, and learns where not to believe it.
        self.trust.out.bias = nn.Parameter(torch.tensor([TRUST, -TRUST]))

    def forward(self, images: Tensor, measured: Tensor) -> Restored:
        """RGB (b, 3, s, s) in [0, 1] and z-depth (b, s, s) in metres, 0 where not measured."""
        near, far = self.config.nearest, self.config.farthest
        known = ((measured > near) & (measured < far)).float()
        scaled = known * (measured - near) / (far - near)
        branches = self.colour(images), self.measured(torch.stack([scaled, known], 1))
        fused = [
            rearrange(fusion(*pair), "b h w c -> b c h w")
            for fusion, *pair in zip(self.fusions, *branches, strict=True)
        ]
        initial = near + (far - near) * (0.5 + self.depth(fused)[:, 0].float())
        return restored(measured * known, initial, self.trust(fused))


def _layer(inputs: int, outputs: int, kernel: int = 3) -> nn.Sequential:
    convolution = nn.Conv2d(inputs, outputs, kernel, padding=kernel // 2, bias=False)
    return nn.Sequential(convolution, nn.GroupNorm(1, outputs), nn.ReLU())


def _resized(x: Tensor, like: Tensor) -> Tensor:
    return F.interpolate(x, size=like.shape[-2:], mode="bilinear", align_corners=False)
