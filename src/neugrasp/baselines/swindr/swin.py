"""Swin transformers (Liu et al., ICCV 2021): attention inside windows, which every other block shifts.

Maps are (b, h, w, c) throughout.
"""

from __future__ import annotations

import math
from functools import lru_cache

import torch
import torch.nn.functional as F
from einops import rearrange
from torch import Tensor, nn


class WindowAttention(nn.Module):
    """What the tokens of one map learn from those of another, or of itself, in the same window."""

    def __init__(self, width: int, heads: int, window: int, shift: int = 0):
        super().__init__()
        self.heads, self.window, self.shift = heads, window, shift
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)
        self.place = nn.Parameter(torch.zeros((2 * window - 1) ** 2, heads))
        nn.init.trunc_normal_(self.place, std=0.02)

    def forward(self, asking: Tensor, told: Tensor) -> Tensor:
        """Maps (b, h, w, c) of one size -> what the first learns, of the same shape."""
        height, width = asking.shape[1:3]
        rows, columns = math.gcd(height, self.window), math.gcd(width, self.window)
        shift = self.shift if min(height // rows, width // columns) > 1 else 0
        asking, told = (torch.roll(x, (-shift, -shift), (1, 2)) if shift else x for x in (asking, told))

        def cut(x: Tensor, parts: int) -> list[Tensor]:
            words = "b (i h) (j w) (part head c) -> part (b i j) head (h w) c"
            return list(rearrange(x, words, h=rows, w=columns, part=parts, head=self.heads))

        (query,), (key, value) = cut(self.query(asking), 1), cut(self.key_value(told), 2)
        bias = self._bias(rows, columns)[None]
        if shift:
            apart = _apart(height, width, rows, columns, shift).to(bias)
            bias = (bias + apart[:, None]).repeat(len(asking), 1, 1, 1)
        found = F.scaled_dot_product_attention(query, key, value, bias.to(query.dtype))
        back = rearrange(
            found,
            "(b i j) head (h w) c -> b (i h) (j w) (head c)",
            i=height // rows,
            j=width // columns,
            h=rows,
        )
        return self.out(torch.roll(back, (shift, shift), (1, 2)) if shift else back)

    def _bias(self, rows: int, columns: int) -> Tensor:
        """(heads, n, n) by how one place of a window lies to another."""
        y, x = torch.meshgrid(torch.arange(rows), torch.arange(columns), indexing="ij")
        y, x = y.flatten(), x.flatten()
        dy, dx = (one[:, None] - one[None] + self.window - 1 for one in (y, x))
        index = (dy * (2 * self.window - 1) + dx).to(self.place.device)
        return self.place[index].permute(2, 0, 1)


@lru_cache(maxsize=32)
def _apart(height: int, width: int, rows: int, columns: int, shift: int) -> Tensor:
    """(windows, n, n): minus infinity between tokens that only the shift around the edge brought together."""

    def region(size: int, window: int) -> Tensor:
        places = torch.arange(size)
        return (places >= size - window).long() + (places >= size - shift).long()

    regions = 3 * region(height, rows)[:, None] + region(width, columns)[None]
    cut = rearrange(regions, "(i h) (j w) -> (i j) (h w)", h=rows, w=columns)
    return torch.where(cut[:, :, None] == cut[:, None, :], 0.0, -torch.inf)


class Perceptron(nn.Sequential):
    """Each token by itself, four times as wide in between."""

    def __init__(self, width: int):
        super().__init__(nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width))


class SwinBlock(nn.Module):
    """Self-attention in windows, then a perceptron, each added to what was there."""

    def __init__(self, width: int, heads: int, window: int, shift: int):
        super().__init__()
        self.before, self.between = nn.LayerNorm(width), nn.LayerNorm(width)
        self.attention = WindowAttention(width, heads, window, shift)
        self.perceptron = Perceptron(width)

    def forward(self, x: Tensor) -> Tensor:
        """(b, h, w, c) -> the same shape."""
        normal = self.before(x)
        x = x + self.attention(normal, normal)
        return x + self.perceptron(self.between(x))


class Merging(nn.Module):
    """Four neighbouring tokens to one, twice as wide."""

    def __init__(self, width: int):
        super().__init__()
        self.normal, self.reduce = nn.LayerNorm(4 * width), nn.Linear(4 * width, 2 * width, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """(b, h, w, c) -> (b, h / 2, w / 2, 2 c)."""
        return self.reduce(self.normal(rearrange(x, "b (h i) (w j) c -> b h w (i j c)", i=2, j=2)))


class Swin(nn.Module):
    """Images to maps at a quarter, an eighth, a sixteenth and a thirty-second of their size."""

    def __init__(
        self, channels: int, width: int, depths: tuple[int, ...], heads: tuple[int, ...], window: int
    ):
        super().__init__()
        widths = [width * 2**i for i in range(len(depths))]
        self.patches = nn.Conv2d(channels, width, 4, stride=4)
        self.first = nn.LayerNorm(width)
        self.merging = nn.ModuleList(map(Merging, widths[:-1]))
        self.stages = nn.ModuleList(
            nn.Sequential(*(SwinBlock(c, h, window, window // 2 * (i % 2)) for i in range(depth)))
            for c, h, depth in zip(widths, heads, depths, strict=True)
        )
        self.last = nn.ModuleList(map(nn.LayerNorm, widths))

    def forward(self, images: Tensor) -> list[Tensor]:
        """(b, channels, h, w) -> a map (b, h / 4, w / 4, width) and three smaller ones."""
        x = self.first(rearrange(self.patches(images), "b c h w -> b h w c"))
        maps = []
        for i, (stage, normal) in enumerate(zip(self.stages, self.last, strict=True)):
            x = stage(self.merging[i - 1](x) if i else x)
            maps.append(normal(x))
        return maps
