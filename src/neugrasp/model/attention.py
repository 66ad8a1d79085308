"""Linear attention (LoFTR's encoder layer), in the two forms the paper needs.

With the feature map phi(x) = elu(x) + 1, a query attends to keys with weights phi(q) . phi(k), normalised
to sum to one; no softmax. Heads are never taken apart: the product with a matrix that is one where two
channels share a head sums over the channels of each head and hands the sum to all of them. So there are only
products with small matrices, and passes over whole tensors.
"""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

EPSILON = 1e-6


BLOCK = 2048
"""Points for which all pairs of tokens fit the cache."""


def positive(x: Tensor) -> Tensor:
    """The feature map elu(x) + 1 of linear attention."""
    below = x.clamp(max=0)
    return torch.exp(below) + (x - below)


class _AttendToTokens(torch.autograd.Function):
    """Messages (m, p, d) to the first m of t tokens (t, p, d) at each of p points, from all of them.

    Block by block and query by query, so that what lies in between stays in the cache; weights of pairs are
    made again for the gradient. `projections` are the matrices of queries, keys and values in one.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, num: int, projections: Tensor, same_head: Tensor) -> Tensor:
        dim = x.shape[-1]
        query = _positive_(F.linear(x[:num], projections[:dim]))
        shared = F.linear(x, projections[dim:])
        key, value = shared.split(dim, dim=-1)
        _positive_(key)
        message, total = torch.empty_like(query), torch.empty_like(query)
        for block in _blocks(x.shape[1]):
            keys, values = key[:, block], value[:, block]
            for index in range(num):
                weights = F.linear(query[index, block] * keys, same_head)
                total[index, block] = _sum(weights).add_(EPSILON)
                message[index, block] = _sum(weights.mul_(values)).div_(total[index, block])
        ctx.save_for_backward(x, projections, same_head, query, shared, message, total)
        return message

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, Tensor, None]:
        x, projections, same_head, query, shared, message, total = ctx.saved_tensors
        num, dim = len(query), x.shape[-1]
        key, value = shared.split(dim, dim=-1)
        to_query, to_shared = torch.empty_like(query), torch.zeros_like(shared)
        to_key, to_value = to_shared.split(dim, dim=-1)
        to_sum = gradient / total
        to_total = to_sum * message
        for block in _blocks(x.shape[1]):
            keys, values = key[:, block], value[:, block]
            for index in range(num):
                one = query[index, block]
                weights = F.linear(one * keys, same_head)
                to_value[:, block].addcmul_(weights, to_sum[index, block])
                torch.mul(values, to_sum[index, block], out=weights).sub_(to_total[index, block])
                to_product = F.linear(weights, same_head)
                to_key[:, block].addcmul_(to_product, one)
                to_query[index, block] = _sum(to_product.mul_(keys))
        to_query.mul_(query.clamp(max=1))
        to_key.mul_(key.clamp(max=1))
        to_x = to_shared @ projections[dim:]
        to_x[:num] += to_query @ projections[:dim]
        rows = to_query.flatten(0, 1).T @ x[:num].flatten(0, 1), to_shared.flatten(0, 1).T @ x.flatten(0, 1)
        return to_x, None, torch.cat(rows), None


def _positive_(x: Tensor) -> Tensor:
    """`positive` in place."""
    below = x.clamp(max=0)
    return x.sub_(below).add_(below.exp_())


def _sum(x: Tensor) -> Tensor:
    """The sum over the first axis; faster than PyTorch's in bfloat16."""
    total = x[0].clone()
    for other in x[1:]:
        total.add_(other)
    return total


def _blocks(num: int) -> list[slice]:
    return [slice(start, start + BLOCK) for start in range(0, num, BLOCK)]


def linear(dim_in: int, dim_out: int) -> nn.Linear:
    """A bias-free linear layer, Xavier-initialised."""
    layer = nn.utils.skip_init(nn.Linear, dim_in, dim_out, bias=False)
    nn.init.xavier_uniform_(layer.weight)
    return layer


def same_head(dim: int, heads: int) -> Tensor:
    """(dim, dim): 1 where two channels belong to one head, else 0."""
    if dim % heads:
        raise ValueError(f"width {dim} is not a multiple of {heads} heads")
    return torch.block_diag(*torch.ones(heads, dim // heads, dim // heads))


class ViewTransformer(nn.Module):
    """A learnable token and the view tokens of a point attend to each other (Eqs. 5, 8, 9).

    What comes out for the learnable token is the unified feature of the point; the others are re-weighted
    view features. There is no position encoding, so the order of the views does not matter.
    """

    same_head: Tensor

    def __init__(self, dim: int, heads: int):
        super().__init__()
        self.register_buffer("same_head", same_head(dim, heads), persistent=False)
        self.token = nn.Parameter(torch.randn(dim, 1))
        self.query = linear(dim, dim)
        self.key = linear(dim, dim)
        self.value = linear(dim, dim)
        self.merge = linear(dim, dim)
        self.expand = linear(2 * dim, 2 * dim)
        self.contract = linear(2 * dim, dim)
        self.norm_message = nn.LayerNorm(dim)
        self.norm_mlp = nn.LayerNorm(dim)

    def forward(self, tokens: Tensor, need_views: bool) -> tuple[Tensor, Tensor | None]:
        """Unified feature (p, d) of view tokens (n, p, d), and the view features (n, p, d) if needed.

        Without `need_views` only the learnable token asks questions, which is a fraction of the work.
        """
        learnable = self.token.T.to(tokens.dtype).expand(1, tokens.shape[1], -1)
        x = torch.cat([learnable, tokens])
        projections = torch.cat([layer.weight for layer in (self.query, self.key, self.value)])
        num = len(x) if need_views else 1
        message = _AttendToTokens.apply(x, num, projections.to(x.dtype), self.same_head.to(x.dtype))
        attended = self._finish(x[:num], message)
        if not need_views:
            return attended[0], None
        unified, views = attended.split([1, len(tokens)])
        return unified[0], views

    def _finish(self, x: Tensor, message: Tensor) -> Tensor:
        message = self.norm_message(self.merge(message))
        mixed = self.contract(F.relu(self.expand(torch.cat([x, message], dim=-1)), inplace=True))
        return x + self.norm_mlp(mixed)


class RayTransformer(nn.Module):
    """The samples of one ray attend to each other (Eq. 6); tensors are (rays, samples, channels)."""

    same_head: Tensor

    def __init__(self, dim: int, heads: int):
        super().__init__()
        self.register_buffer("same_head", same_head(dim, heads), persistent=False)
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
        query = positive(self.query(x)) * asks.unsqueeze(-1)
        key, value = positive(self.key(x)), self.value(x)
        context = (key.transpose(1, 2) @ value) * self.same_head.to(value.dtype)
        total = F.linear(query * key.sum(1, keepdim=True), self.same_head)
        message = self.norm_message(self.merge((query @ context) / (total + EPSILON)))
        return x + self.norm_mlp(self.mlp(torch.cat([x, message], dim=-1)))
