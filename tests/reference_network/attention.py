"""LoFTR's encoder layer with linear attention, over any sequences: one einsum for each sum of the paper."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

EPSILON = 1e-6


class PlainEncoderLayer(nn.Module):
    """Every token of a sequence attends to every other; (sequences, tokens, channels) in and out."""

    def __init__(self, dim: int, heads: int):
        super().__init__()
        self.heads = heads
        self.query = nn.Linear(dim, dim, bias=False)
        self.key = nn.Linear(dim, dim, bias=False)
        self.value = nn.Linear(dim, dim, bias=False)
        self.merge = nn.Linear(dim, dim, bias=False)
        self.mlp = nn.Sequential(
            nn.Linear(2 * dim, 2 * dim, bias=False), nn.ReLU(), nn.Linear(2 * dim, dim, bias=False)
        )
        self.norm_message = nn.LayerNorm(dim)
        self.norm_mlp = nn.LayerNorm(dim)

    def forward(self, x: Tensor, asks: Tensor | None = None) -> Tensor:
        """Tokens that do not ask (`asks` (n, t) false) get an empty message."""
        query = self._split(F.elu(self.query(x)) + 1)
        key = self._split(F.elu(self.key(x)) + 1)
        value = self._split(self.value(x)) / x.shape[1]
        if asks is not None:
            query = query * asks[:, :, None, None]
        context = torch.einsum("nshd,nshv->nhdv", key, value)
        share = 1 / (torch.einsum("nlhd,nhd->nlh", query, key.sum(dim=1)) + EPSILON)
        message = torch.einsum("nlhd,nhdv,nlh->nlhv", query, context, share) * x.shape[1]
        message = self.norm_message(self.merge(message.flatten(2)))
        return x + self.norm_mlp(self.mlp(torch.cat([x, message], dim=-1)))

    def _split(self, x: Tensor) -> Tensor:
        return x.unflatten(-1, (self.heads, -1))


class PlainViewTransformer(PlainEncoderLayer):
    """The same with a learnable token before the tokens of the views (Eqs. 5, 8, 9)."""

    def __init__(self, dim: int, heads: int):
        super().__init__(dim, heads)
        self.token = nn.Parameter(torch.zeros(dim, 1))

    def forward(self, x: Tensor, asks: Tensor | None = None) -> Tensor:
        """Views (p, n, d) to unified feature and re-weighted views (p, 1 + n, d)."""
        token = self.token.T.expand(len(x), 1, -1)
        return super().forward(torch.cat([token, x], dim=1), asks)
