"""Linear attention (LoFTR's encoder layer), in the two forms the paper needs.

With the feature map phi(x) = elu(x) + 1, a query attends to keys with weights phi(q) . phi(k), normalised
to sum to one; no softmax. `ViewTransformer` works on a handful of tokens at very many points, so tensors
there are (tokens, channels, points): every operation is a large matrix product or runs along the points.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from einops import rearrange
from torch import Tensor, nn

EPSILON = 1e-6


def positive(x: Tensor) -> Tensor:
    """The feature map elu(x) + 1 of linear attention."""
    return F.elu(x) + 1


class ChannelNorm(nn.Module):
    """Layer normalisation over the channels of (..., channels, points)."""

    def __init__(self, dim: int):
        super().__init__()
        self.weight = nn.Parameter(torch.ones(dim))
        self.bias = nn.Parameter(torch.zeros(dim))

    def forward(self, x: Tensor) -> Tensor:
        """Same shape, zero mean and unit variance over the channels, then scaled and shifted."""
        # Four times as fast as `var_mean`, which walks down the channels point by point.
        centred = x - x.mean(-2, keepdim=True)
        scale = torch.rsqrt(centred.square().mean(-2, keepdim=True) + 1e-5)
        return torch.addcmul(self.bias[:, None], centred * scale, self.weight[:, None])


class PointLinear(nn.Module):
    """A bias-free linear layer on (..., channels, points), Xavier-initialised."""

    def __init__(self, dim_in: int, dim_out: int):
        super().__init__()
        self.weight = nn.Parameter(torch.empty(dim_out, dim_in))
        nn.init.xavier_uniform_(self.weight)

    def forward(self, x: Tensor) -> Tensor:
        """(..., dim_in, p) to (..., dim_out, p)."""
        if x.dim() == 2:
            return self.weight @ x
        # `matmul` would fold the tokens into the points, which moves every tensor twice.
        return torch.bmm(self.weight.expand(len(x), -1, -1), x)


class ViewTransformer(nn.Module):
    """A learnable token and the view tokens of a point attend to each other (Eqs. 5, 8, 9).

    What comes out for the learnable token is the unified feature of the point; the others are re-weighted
    view features. There is no position encoding, so the order of the views does not matter.
    """

    def __init__(self, dim: int, heads: int):
        super().__init__()
        if dim % heads:
            raise ValueError(f"token width {dim} is not a multiple of {heads} heads")
        self.heads = heads
        self.token = nn.Parameter(torch.randn(dim, 1))
        self.query = PointLinear(dim, dim)
        self.key = PointLinear(dim, dim)
        self.value = PointLinear(dim, dim)
        self.merge = PointLinear(dim, dim)
        self.expand = PointLinear(2 * dim, 2 * dim)
        self.contract = PointLinear(2 * dim, dim)
        self.norm_message = ChannelNorm(dim)
        self.norm_mlp = ChannelNorm(dim)

    def forward(self, tokens: Tensor, need_views: bool) -> tuple[Tensor, Tensor | None]:
        """Unified feature (d, p) of view tokens (n, d, p), and the view features (n, d, p) if needed.

        Without `need_views` only the learnable token asks questions, which is a fraction of the work.
        """
        points = tokens.shape[-1]
        key = positive(self.key(tokens))
        value = self.value(tokens)
        token_key = positive(self.key(self.token)).expand(-1, points).unsqueeze(0)
        token_value = self.value(self.token).expand(-1, points).unsqueeze(0)
        key, value = torch.cat([token_key, key]), torch.cat([token_value, value])
        unified = self._finish(
            self.token.expand(-1, points), self._attend_constant(positive(self.query(self.token)), key, value)
        )
        if not need_views:
            return unified, None
        queries = positive(self.query(tokens))
        messages = torch.stack([self._attend(query, key, value) for query in queries])
        return unified, self._finish(tokens, messages)

    def _attend(self, query: Tensor, key: Tensor, value: Tensor) -> Tensor:
        """Message (d, p) of one query token (d, p) to tokens (t, d, p)."""
        scores = rearrange(query * key, "t (h d) p -> t h d p", h=self.heads).sum(2)
        return self._weigh(scores, value)

    def _attend_constant(self, query: Tensor, key: Tensor, value: Tensor) -> Tensor:
        """The same for a query (d, 1) that all points share: scores become one matrix product."""
        blocks = torch.block_diag(*rearrange(query, "(h d) one -> h one d", h=self.heads).unbind(0))
        return self._weigh(torch.bmm(blocks.expand(len(key), -1, -1), key), value)

    def _weigh(self, scores: Tensor, value: Tensor) -> Tensor:
        weights = scores / (scores.sum(0, keepdim=True) + EPSILON)
        split = rearrange(value, "t (h d) p -> t h d p", h=self.heads)
        return rearrange((weights.unsqueeze(2) * split).sum(0), "h d p -> (h d) p")

    def _finish(self, x: Tensor, message: Tensor) -> Tensor:
        message = self.norm_message(self.merge(message))
        mixed = self.contract(F.relu(self.expand(torch.cat([x, message], dim=-2))))
        return x + self.norm_mlp(mixed)


class RayTransformer(nn.Module):
    """The samples of one ray attend to each other (Eq. 6); tensors are (rays, samples, channels)."""

    def __init__(self, dim: int, heads: int):
        super().__init__()
        if dim % heads:
            raise ValueError(f"ray feature width {dim} is not a multiple of {heads} heads")
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
        for module in self.modules():
            if isinstance(module, nn.Linear):
                nn.init.xavier_uniform_(module.weight)

    def forward(self, x: Tensor, asks: Tensor) -> Tensor:
        """Same shape as x (r, s, d). Samples that do not ask (`asks` (r, s) false) get no message in."""
        heads = "r s (h d) -> r h s d"
        query = rearrange(positive(self.query(x)) * asks.unsqueeze(-1), heads, h=self.heads)
        key = rearrange(positive(self.key(x)), heads, h=self.heads)
        value = rearrange(self.value(x), heads, h=self.heads) / x.shape[1]
        context = key.transpose(-1, -2) @ value
        total = query @ key.sum(dim=2).unsqueeze(-1)
        message = (query @ context) / (total + EPSILON) * x.shape[1]
        message = self.norm_message(self.merge(rearrange(message, "r h s d -> r s (h d)")))
        return x + self.norm_mlp(self.mlp(torch.cat([x, message], dim=-1)))
