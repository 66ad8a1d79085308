"""`ViewTransformer` and its gradient by hand, for training on a CPU in bfloat16.

Processes points in blocks, so that intermediates stay in the cache, with tensors laid out as (channels,
tokens, points): sums over channels or tokens become passes over long rows. Element-wise passes are in
float32; products, and what is kept for the gradient, in the precision of the tokens.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple, Protocol

import torch
from jaxtyping import Float
from torch import Tensor, nn

EPSILON = 1e-6
"""Added to the sum of a query's weights."""
NORM_EPSILON = 1e-5
"""PyTorch's, of layer normalisation."""
BLOCK = 2048
"""Points at a time."""


def pays(tokens: Float[Tensor, "views points channels"]) -> bool:
    """Whether it is faster than the plain layer: on a CPU in bfloat16 where a gradient is wanted.

    In float32 and without a gradient the plain layer is as fast (docs/performance.md).
    """
    return tokens.device.type == "cpu" and tokens.dtype == torch.bfloat16 and torch.is_grad_enabled()


def attend(
    layer: ViewLayer, tokens: Float[Tensor, "views points channels"], num: int
) -> Float[Tensor, "{num} points channels"]:
    """What the first `num` of the layer's token and the tokens become."""
    attended: Tensor = _Attention.apply(layer.heads, num, tokens, *LayerWeights.of(layer))
    return attended


class ViewLayer(Protocol):
    """A view transformer, as far as it matters here."""

    heads: int
    token: nn.Parameter
    query: nn.Linear
    key: nn.Linear
    value: nn.Linear
    merge: nn.Linear
    expand: nn.Linear
    contract: nn.Linear
    norm_message: nn.LayerNorm
    norm_mlp: nn.LayerNorm


def positive(x: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """The feature map elu(x) + 1 of linear attention."""
    return x.clamp(max=0).exp() + x.clamp(min=0)


def centred(weight: Float[Tensor, "out channels"]) -> Float[Tensor, "out channels"]:
    """The weight, but for a mean of 0 over the channels that come out."""
    return weight - weight.mean(0)


class LayerWeights(NamedTuple):
    """Layer weights with per-point work folded in: layer norm's scale and shift, centring, order of heads."""

    token: Float[Tensor, " d"]
    """The learnable token."""
    asking: Float[Tensor, "3*d d"]
    """Queries, then the token's share in the hidden layer."""
    shared: Float[Tensor, "2*d d"]
    """Keys, then values. Their channels and the queries' are ordered by place in the head first."""
    merge: Float[Tensor, "d d"]
    """`centred`, of messages ordered likewise."""
    from_message: Float[Tensor, "2*d d"]
    """The share in the hidden layer of a message that is normalised, but not scaled."""
    bias: Float[Tensor, "2*d 1"]
    """Bias of the hidden layer: what the shift of normalised messages does there."""
    contract: Float[Tensor, "d 2*d"]
    """`centred`."""
    scale: Float[Tensor, "d 1"]
    """Scale of what is normalised last."""
    shift: Float[Tensor, "d 1"]
    """Likewise."""

    @classmethod
    def of(cls, layer: ViewLayer) -> LayerWeights:
        """The weights of a view transformer."""
        dim = len(layer.token)
        by_place = torch.arange(dim).unflatten(0, (layer.heads, -1)).T.flatten()
        from_token, from_message = layer.expand.weight.split(dim, dim=1)
        return cls(
            layer.token.squeeze(1),
            torch.cat([layer.query.weight[by_place], from_token]),
            torch.cat([layer.key.weight[by_place], layer.value.weight[by_place]]),
            centred(layer.merge.weight[:, by_place]),
            from_message * layer.norm_message.weight,
            (from_message @ layer.norm_message.bias).unsqueeze(1),
            centred(layer.contract.weight),
            layer.norm_mlp.weight.unsqueeze(1),
            layer.norm_mlp.bias.unsqueeze(1),
        )

    def rounded(self, kind: torch.dtype) -> LayerWeights:
        """For products in another precision, as plain numbers: gradients are made by hand."""
        *products, scale, shift = (one.detach() for one in self)
        return LayerWeights._make([*(one.to(kind) for one in products), scale, shift])

    def joined(self, tokens: Float[Tensor, "views points d"]) -> Float[Tensor, "1+views points d"]:
        """The learnable token, then the tokens."""
        return torch.cat([self.token.expand(1, tokens.shape[1], -1), tokens])


class _Kept(NamedTuple):
    """What is kept of a block for the gradient; (k, tokens points), or with the channels split into place
    and head."""

    query: Tensor
    key: Tensor
    value: Tensor
    message: Tensor
    merged: Tensor
    merged_scale: Tensor
    hidden: Tensor
    mixed: Tensor
    mixed_scale: Tensor


class _Attention(torch.autograd.Function):
    """(m, p, d): what the first m of the learnable token and tokens (n, p, d) become."""

    @staticmethod
    def forward(ctx: Any, heads: int, num: int, tokens: Tensor, *weights: Tensor) -> Tensor:
        own = LayerWeights(*weights).rounded(tokens.dtype)
        result = tokens.new_empty(num, *tokens.shape[1:])
        kept: list[Tensor] = []
        for block in _blocks(tokens):
            x = own.joined(tokens[:, block])
            change, some = _change(own, x, heads, num)
            torch.add(x[:num], change.view(-1, num, x.shape[1]).permute(1, 2, 0), out=result[:, block])
            if any(ctx.needs_input_grad):
                kept += some
        ctx.save_for_backward(tokens, *weights, *kept)
        return result

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        tokens, *others = ctx.saved_tensors
        own, kept = LayerWeights(*others[: len(LayerWeights._fields)]), others[len(LayerWeights._fields) :]
        to_tokens, totals = torch.empty_like(tokens), [torch.zeros_like(one) for one in own]
        own = own.rounded(tokens.dtype)
        each = len(_Kept._fields)
        for index, block in enumerate(_blocks(tokens)):
            some = _Kept(*kept[each * index : each * (index + 1)])
            x = own.joined(tokens[:, block])
            to_x, *parts = _pulled(own, x, some, gradient[:, block])
            to_tokens[:, block] = to_x[1:]
            for total, part in zip(totals, (to_x[0].sum(0), *parts), strict=True):
                total.add_(part)
        return None, None, to_tokens, *totals


def _blocks(tokens: Tensor) -> list[slice]:
    return [slice(start, start + BLOCK) for start in range(0, tokens.shape[1], BLOCK)]


def _change(own: LayerWeights, x: Tensor, heads: int, num: int) -> tuple[Tensor, _Kept]:
    """What is added (d, m p) to the first m of tokens (t, p, d)."""
    num_tokens, points, dim = x.shape
    kind = x.dtype
    asking = own.asking @ x[:num].flatten(0, 1).T
    shared = own.shared @ x.flatten(0, 1).T
    query = positive(asking[:dim].float()).view(-1, heads, num, points)
    key = positive(shared[:dim].float()).view(-1, heads, num_tokens, points)
    value = shared[dim:].float().view(-1, heads, num_tokens, points)
    message = _weighted(_shares(query, key)[0], value).view(dim, -1).to(kind)
    merged, merged_scale = _normalised((own.merge @ message).float())
    merged = merged.to(kind)
    hidden = torch.addmm(asking[dim:], own.from_message, merged).add_(own.bias).relu_()
    mixed, mixed_scale = _normalised((own.contract @ hidden).float())
    pairs = query.to(kind), key.to(kind), value.to(kind)
    kept = _Kept(*pairs, message, merged, merged_scale, hidden, mixed.to(kind), mixed_scale)
    return torch.addcmul(own.shift, mixed, own.scale), kept


def _pulled(own: LayerWeights, x: Tensor, kept: _Kept, gradient: Tensor) -> tuple[Tensor, ...]:
    """Gradients of tokens (t, p, d), and of the weights after the first, from one (m, p, d)."""
    num, points, dim = gradient.shape
    kind = x.dtype
    pull = gradient.permute(2, 0, 1).to(torch.float32, copy=True, memory_format=torch.contiguous_format)
    pull = pull.view(dim, -1)
    mixed = kept.mixed.float()
    to_scale, to_shift = (pull * mixed).sum(1, keepdim=True), pull.sum(1, keepdim=True)
    to_mixed = _before_norm(pull.mul_(own.scale), mixed, kept.mixed_scale).to(kind)
    to_asking, to_shared = x.new_empty(3 * dim, num * points), x.new_empty(2 * dim, len(x) * points)
    to_hidden = torch.mm(own.contract.T, to_mixed, out=to_asking[dim:]).mul_(kept.hidden.sign())
    to_merged = (own.from_message.T @ to_hidden).float()
    to_merged = _before_norm(to_merged, kept.merged.float(), kept.merged_scale).to(kind)
    to_message = (own.merge.T @ to_merged).float().view_as(kept.query)
    to_query, to_key, to_value = _before_attention(kept, to_message)
    to_asking[:dim] = to_query.view(dim, -1)
    to_shared[:dim], to_shared[dim:] = to_key.view(dim, -1), to_value.view(dim, -1)
    tokens = x.flatten(0, 1)
    to_tokens = to_shared.T @ own.shared
    to_tokens[: num * points].addmm_(to_asking.T, own.asking).add_(gradient.reshape(-1, dim))
    return (
        to_tokens.view_as(x),
        to_asking @ tokens[: num * points],
        to_shared @ tokens,
        to_merged @ kept.message.T,
        to_hidden @ kept.merged.T,
        to_hidden.sum(1, keepdim=True),
        to_mixed @ kept.hidden.T,
        to_scale,
        to_shift,
    )


def _before_attention(kept: _Kept, gradient: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Gradients of queries, keys and values before they were made `positive`, from one of the messages."""
    query, key, value = kept.query.float(), kept.key.float(), kept.value.float()
    shares, total = _shares(query, key)
    to_value = _weighted(shares.transpose(1, 2), gradient)
    to_weights = _products(gradient, value)
    to_weights.sub_(shares.mul_(to_weights).sum(2, keepdim=True)).div_(total)
    to_query = _weighted(to_weights, key).mul_(query.clamp(max=1))
    to_key = _weighted(to_weights.transpose(1, 2), query).mul_(key.clamp(max=1))
    return to_query, to_key, to_value


def _shares(query: Tensor, key: Tensor) -> tuple[Tensor, Tensor]:
    """The share of each pair (h, m, t, p) in the sum (h, m, 1, p) of its query's weights, and that sum."""
    weights = _products(query, key)
    total = weights.sum(2, keepdim=True).add_(EPSILON)
    return weights.div_(total), total


def _products(ones: Tensor, others: Tensor) -> Tensor:
    """Sums of products of (c, h, m, p) and (c, h, t, p) over the channels of a head, for each pair (h, m,
    t, p)."""
    return _sum_of_products(ones.unsqueeze(3), others.unsqueeze(2))


def _weighted(weights: Tensor, values: Tensor) -> Tensor:
    """Sums (c, h, m, p) of values (c, h, t, p) with weights (h, m, t, p)."""
    return _sum_of_products(weights.unbind(2), values.unsqueeze(2).unbind(3))


def _sum_of_products(ones: Iterable[Tensor], others: Iterable[Tensor]) -> Tensor:
    """Pair by pair, in one tensor."""
    first, *rest = zip(ones, others, strict=True)
    result = torch.mul(*first)
    for pair in rest:
        result.addcmul_(*pair)
    return result


def _normalised(x: Tensor) -> tuple[Tensor, Tensor]:
    """(d, p) of mean 0 over the channels with variance 1, in place, and what it was multiplied by (p,)."""
    scale = x.square().mean(0).add_(NORM_EPSILON).rsqrt_()
    return x.mul_(scale), scale


def _before_norm(gradient: Tensor, result: Tensor, scale: Tensor) -> Tensor:
    """The gradient of what was `_normalised`, in place of that of the result."""
    along = (gradient * result).mean(0)
    return gradient.addcmul_(result, along, value=-1).mul_(scale)
