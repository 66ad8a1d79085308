"""Linear attention (LoFTR's encoder layer), in the two forms the paper needs.

With the feature map phi(x) = elu(x) + 1, a query attends to keys with weights phi(q) . phi(k), normalised
to sum to one; no softmax.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from neugrasp.geometry.sampling import full_precision
from neugrasp.model.view_layer import EPSILON, PLAIN, LayerWeights, ViewLayer, centred, positive


def linear(dim_in: int, dim_out: int) -> nn.Linear:
    """A bias-free linear layer, Xavier-initialised."""
    layer = nn.utils.skip_init(nn.Linear, dim_in, dim_out, bias=False)
    nn.init.xavier_uniform_(layer.weight)
    return layer


def channels_of_a_head(dim: int, heads: int) -> int:
    """How many of the channels each head has. Raises `ValueError` where they cannot be shared out."""
    if dim % heads:
        raise ValueError(f"width {dim} is not a multiple of {heads} heads")
    return dim // heads


def same_head(dim: int, heads: int) -> Tensor:
    """(dim, dim): 1 where two channels belong to one head, else 0."""
    size = channels_of_a_head(dim, heads)
    return torch.block_diag(*torch.ones(heads, size, size))


class ViewTransformer(nn.Module):
    """A learnable token and the view tokens of a point attend to each other (Eqs. 5, 8, 9).

    What comes out for the learnable token is the unified feature of the point; the others are re-weighted
    view features. There is no position encoding, so the order of the views does not matter.
    """

    def __init__(self, dim: int, heads: int):
        super().__init__()
        self.heads, self.places = heads, channels_of_a_head(dim, heads)
        self.passes = PLAIN
        self.token = nn.Parameter(torch.randn(dim, 1))
        self.query = linear(dim, dim)
        self.key = linear(dim, dim)
        self.value = linear(dim, dim)
        self.merge = linear(dim, dim)
        self.expand = linear(2 * dim, 2 * dim)
        self.contract = linear(2 * dim, dim)
        self.norm_message = nn.LayerNorm(dim)
        self.norm_mlp = nn.LayerNorm(dim)

    @full_precision
    def forward(self, tokens: Tensor, need_views: bool) -> tuple[Tensor, Tensor | None]:
        """Unified feature (p, d) of view tokens (n, p, d), and the view features (n, p, d) if needed.

        Without `need_views` only the learnable token asks questions, which is a fraction of the work.
        """
        num = 1 + len(tokens) if need_views else 1
        attended: Tensor = ViewLayer.apply(self.passes, self.heads, num, tokens, *self._weights())
        return attended[0], attended[1:] if need_views else None

    def _weights(self) -> LayerWeights:
        dim = len(self.token)
        by_place = torch.arange(dim).unflatten(0, (self.heads, self.places)).T.flatten()
        from_token, from_message = self.expand.weight.split(dim, dim=1)
        return LayerWeights(
            self.token.squeeze(1),
            torch.cat([self.query.weight[by_place], from_token]),
            torch.cat([self.key.weight[by_place], self.value.weight[by_place]]),
            centred(self.merge.weight[:, by_place]),
            from_message * self.norm_message.weight,
            (from_message @ self.norm_message.bias).unsqueeze(1),
            centred(self.contract.weight),
            self.norm_mlp.weight.unsqueeze(1),
            self.norm_mlp.bias.unsqueeze(1),
        )


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
