"""Linear attention (LoFTR's encoder layer), in the two forms the paper needs.

With the feature map phi(x) = elu(x) + 1, a query attends to keys with weights phi(q) . phi(k), normalised
to sum to one; no softmax.
"""

from __future__ import annotations

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from neugrasp.kernels import view_attention
from neugrasp.model.initial import fill

EPSILON = 1e-6
"""Added to the sum of a query's weights."""


def feature_map(x: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """elu(x) + 1, which is positive."""
    if x.device.type == "cpu" and not torch.is_grad_enabled():
        return view_attention.positive(x)  # expm1 takes longer than what fusing it saves
    return F.elu(x) + 1


def linear(dim_in: int, dim_out: int) -> nn.Linear:
    """A bias-free linear layer, Xavier-initialised; nothing is drawn besides."""
    layer = nn.Linear(dim_in, dim_out, bias=False, device="meta")
    layer.weight = nn.Parameter(torch.empty(dim_out, dim_in))
    fill(layer.weight, nn.init.xavier_uniform_)
    return layer


def same_head(dim: int, heads: int) -> Float[Tensor, "{dim} {dim}"]:
    """1 where two channels belong to one head, else 0; a product with it sums within each head.

    Raises `ValueError` where the channels cannot be shared out among the heads.
    """
    if dim % heads:
        raise ValueError(f"width {dim} is not a multiple of {heads} heads")
    # By NumPy: PyTorch, asked for shapes only, would load its compiler for it (`initial.fill`).
    block = np.ones((dim // heads, dim // heads), dtype=np.float32)
    return torch.from_numpy(np.kron(np.eye(heads, dtype=np.float32), block))


class ViewTransformer(nn.Module):
    """A learnable token and the view tokens of a point attend to each other (Eqs. 5, 8, 9).

    What comes out for the learnable token is the unified feature of the point; the others are re-weighted
    view features. There is no position encoding, so the order of the views does not matter.
    """

    same_head: Float[Tensor, "d d"]

    def __init__(self, dim: int, heads: int):
        super().__init__()
        self.heads = heads
        self.register_buffer("same_head", same_head(dim, heads), persistent=False)
        self.token = nn.Parameter(torch.empty(dim, 1))
        fill(self.token, nn.init.normal_)
        self.query = linear(dim, dim)
        self.key = linear(dim, dim)
        self.value = linear(dim, dim)
        self.merge = linear(dim, dim)
        self.expand = linear(2 * dim, 2 * dim)
        self.contract = linear(2 * dim, dim)
        self.norm_message = nn.LayerNorm(dim)
        self.norm_mlp = nn.LayerNorm(dim)

    def forward(
        self, tokens: Float[Tensor, "views points channels"], need_views: bool
    ) -> tuple[Float[Tensor, "points channels"], Float[Tensor, "views points channels"] | None]:
        """Unified feature of view tokens, and the view features if needed.

        Without `need_views` only the learnable token asks questions, which is a fraction of the work.
        """
        if view_attention.pays(tokens):
            attended = view_attention.attend(self, tokens, 1 + len(tokens) if need_views else 1)
            return attended[0], attended[1:] if need_views else None
        if not need_views:
            return self._unified(tokens).to(tokens.dtype), None
        x = torch.cat([self.token.T.to(tokens.dtype).expand(1, tokens.shape[1], -1), tokens])
        query, key, value = feature_map(self.query(x)), feature_map(self.key(x)), self.value(x)
        weights = F.linear(query.unsqueeze(1) * key, self.same_head)  # (queries, tokens, p, d)
        message = (weights * value).sum(1) / (weights.sum(1) + EPSILON)
        message = self.norm_message(self.merge(message)).to(x.dtype)
        hidden = F.relu(self.expand(torch.cat([x, message], dim=-1)))
        attended = x + self.norm_mlp(self.contract(hidden)).to(x.dtype)
        return attended[0], attended[1:]

    def _unified(self, tokens: Float[Tensor, "views points channels"]) -> Float[Tensor, "points channels"]:
        """The unified feature alone: the token is the same at every point, and so is all that it asks."""
        token = self.token.T
        asked = feature_map(self.query(token)) * self.same_head
        own, weights = (F.linear(feature_map(self.key(x)), asked) for x in (token, tokens))
        message = own * self.value(token) + (weights * self.value(tokens)).sum(0)
        message = self.norm_message(self.merge(message / (own + weights.sum(0) + EPSILON)))
        from_token, from_message = self.expand.weight.split(len(self.token), dim=1)
        hidden = F.relu(F.linear(message, from_message, F.linear(token, from_token).squeeze(0)))
        return token + self.norm_mlp(self.contract(hidden))


class RayTransformer(nn.Module):
    """The samples of one ray attend to each other (Eq. 6)."""

    same_head: Float[Tensor, "d d"]

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
                fill(module.weight, nn.init.xavier_uniform_)

    def forward(
        self, x: Float[Tensor, "rays samples channels"], query_mask: Bool[Tensor, "rays samples"]
    ) -> Float[Tensor, "rays samples channels"]:
        """The features after it. Samples outside the mask get no message in."""
        query = feature_map(self.query(x)) * query_mask.unsqueeze(-1)
        key, value = feature_map(self.key(x)), self.value(x)
        # Of all pairs of channels, the products of those within a head: as fast as one head alone.
        context = (key.transpose(1, 2) @ value) * self.same_head.to(value.dtype)
        total = F.linear(query * key.sum(1, keepdim=True), self.same_head)
        message = self.norm_message(self.merge((query @ context) / (total + EPSILON)))
        return x + self.norm_mlp(self.mlp(torch.cat([x, message], dim=-1)))
