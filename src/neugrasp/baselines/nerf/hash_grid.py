"""Multi-resolution hash grids (Mueller et al., SIGGRAPH 2022): features of points, learned in tables."""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

PRIMES = (1, -1_640_531_535, 805_459_861)
"""The paper's, as 32-bit integers, whose products wrap around."""
SPREAD = 1e-4
"""Entries begin uniformly between minus and plus this."""


class HashGrid(nn.Module):
    """Points of the unit cube to `levels` x `features` numbers, continuous and trilinear between corners.

    The number of cells along an edge grows geometrically from `coarsest` to `finest`. A level with more
    corners than a table has entries shares them by hashing.
    """

    cells: Tensor
    starts: Tensor
    in_order: Tensor

    def __init__(self, levels: int, features: int, log2_entries: int, coarsest: int, finest: int):
        super().__init__()
        self.entries = 2**log2_entries
        ratio = (finest / coarsest) ** (1 / max(1, levels - 1))
        cells = torch.tensor([round(coarsest * ratio**i) for i in range(levels)], dtype=torch.int32)
        self.register_buffer("cells", cells, persistent=False)
        starts = torch.arange(levels, dtype=torch.int32) * self.entries
        self.register_buffer("starts", starts[:, None], persistent=False)
        in_order = (cells + 1).long() ** 3 <= self.entries
        self.register_buffer("in_order", in_order[:, None], persistent=False)
        self.table = nn.Parameter(torch.empty(levels * self.entries, features).uniform_(-SPREAD, SPREAD))

    @property
    def width(self) -> int:
        """Numbers that a point gets."""
        return len(self.cells) * self.table.shape[1]

    def forward(self, points: Tensor) -> Tensor:
        """(n, 3) in [0, 1] -> (n, width)."""
        scaled = points[:, :, None] * self.cells
        lower = torch.minimum(scaled.int(), self.cells - 1)
        above = scaled - lower
        x, y, z = torch.stack([lower, lower + 1], -1).unbind(1)
        wx, wy, wz = torch.stack([1 - above, above], -1).unbind(1)
        weights = (wx[..., :, None, None] * wy[..., None, :, None] * wz[..., None, None, :]).flatten(-3)
        index = torch.where(self.in_order, self._placed(x, y, z), self._hashed(x, y, z)) + self.starts
        found: Tensor = _WeightedSum.apply(self.table, index.reshape(-1, 8), weights.reshape(-1, 8))
        return found.reshape(len(points), self.width)

    def _placed(self, x: Tensor, y: Tensor, z: Tensor) -> Tensor:
        """Entries (n, levels, 8) of lower and upper coordinates (n, levels, 2), one after the other."""
        edge = (self.cells + 1)[:, None]
        return (
            (x * edge * edge)[..., :, None, None] + (y * edge)[..., None, :, None] + z[..., None, None, :]
        ).flatten(-3)

    def _hashed(self, x: Tensor, y: Tensor, z: Tensor) -> Tensor:
        """The same where several corners share an entry."""
        a, b, c = (axis * prime for axis, prime in zip((x, y, z), PRIMES, strict=True))
        mixed = a[..., :, None, None] ^ b[..., None, :, None] ^ c[..., None, None, :]
        return mixed.flatten(-3) & (self.entries - 1)


class _WeightedSum(torch.autograd.Function):
    """Rows (m, f) of weighted entries. The way back adds up one feature after the other, on a processor ten
    times faster than PyTorch's own."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, index: Tensor, weights: Tensor) -> Tensor:
        ctx.save_for_backward(index, weights)
        ctx.entries = len(table)
        return F.embedding_bag(index, table, per_sample_weights=weights, mode="sum")

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:
        index, weights = ctx.saved_tensors
        where = index.reshape(-1).long()
        columns = [
            gradient.new_zeros(ctx.entries).scatter_add_(0, where, (weights * one[:, None]).reshape(-1))
            for one in gradient.unbind(1)
        ]
        return torch.stack(columns, 1), None, None
