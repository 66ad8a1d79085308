"""Linear attention against its definition, written out."""

from __future__ import annotations

import pytest
import torch
from torch.testing import assert_close

from neugrasp.model.attention import RayTransformer, ViewTransformer, feature_map
from reference_network.attention import PlainViewTransformer
from reference_network.network import renamed


def attend(query: torch.Tensor, key: torch.Tensor, value: torch.Tensor, heads: int) -> torch.Tensor:
    """(s, d) tokens of one point: the definition, one head at a time."""
    out = []
    for q, k, v in zip(*(x.chunk(heads, dim=1) for x in (query, key, value)), strict=True):
        weights = feature_map(q) @ feature_map(k).T
        out.append(weights / weights.sum(1, keepdim=True) @ v)
    return torch.cat(out, dim=1)


def finish(layer: ViewTransformer | RayTransformer, x: torch.Tensor, message: torch.Tensor) -> torch.Tensor:
    """The rest of LoFTR's encoder layer on (s, d)."""

    def norm(y: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.layer_norm(y, y.shape[-1:])

    message = norm(message @ layer.merge.weight.T)
    first, last = (
        (layer.expand.weight, layer.contract.weight)
        if isinstance(layer, ViewTransformer)
        else (layer.mlp[0].weight, layer.mlp[2].weight)
    )
    return x + norm(torch.relu(torch.cat([x, message], 1) @ first.T) @ last.T)


def test_view_transformer_is_linear_attention_of_token_and_views():
    torch.manual_seed(0)
    layer = ViewTransformer(12, heads=4)
    tokens = torch.randn(5, 7, 12)
    unified, views = layer(tokens, need_views=True)
    assert views is not None
    for point in range(7):
        x = torch.cat([layer.token.T, tokens[:, point]])
        message = attend(x @ layer.query.weight.T, x @ layer.key.weight.T, x @ layer.value.weight.T, 4)
        expected = finish(layer, x, message)
        assert_close(unified[point], expected[0], atol=1e-4, rtol=1e-4)
        assert_close(views[:, point], expected[1:], atol=1e-4, rtol=1e-4)


def test_unified_feature_and_its_gradients_are_the_same_without_view_features():
    torch.manual_seed(0)
    layer = ViewTransformer(8, heads=2)
    tokens = torch.randn(3, 11, 8, requires_grad=True)
    alone, together = (layer(tokens, need_views=views)[0] for views in (False, True))
    assert_close(alone, together)
    pull, wanted = torch.randn_like(alone), [tokens, *layer.parameters()]
    for own, same in zip(*(torch.autograd.grad(one, wanted, pull) for one in (alone, together)), strict=True):
        assert_close(own, same, atol=1e-4, rtol=1e-4)


def test_ray_transformer_is_linear_attention_along_each_ray():
    torch.manual_seed(0)
    layer = RayTransformer(12, heads=3)
    x = torch.randn(4, 9, 12)
    result = layer(x, torch.ones(4, 9, dtype=torch.bool))
    for ray in range(4):
        message = attend(layer.query(x[ray]), layer.key(x[ray]), layer.value(x[ray]), 3)
        assert_close(result[ray], finish(layer, x[ray], message), atol=1e-4, rtol=1e-4)


def test_rays_do_not_see_each_other():
    torch.manual_seed(0)
    layer = RayTransformer(8, heads=2)
    x, asks = torch.randn(5, 6, 8), torch.ones(5, 6, dtype=torch.bool)
    assert_close(layer(x, asks)[2:3], layer(x[2:3], asks[2:3]))


def test_gradients_of_the_view_transformer_are_those_of_the_plain_layer():
    torch.manual_seed(0)
    layer, plain = ViewTransformer(12, heads=4), PlainViewTransformer(12, heads=4)
    plain.load_state_dict({renamed(f"view_transformers.{n}")[18:]: p for n, p in layer.state_dict().items()})
    tokens = torch.randn(3, 50, 12)
    ours, theirs = tokens.clone().requires_grad_(), tokens.clone().requires_grad_()
    unified, views = layer(ours, need_views=True)
    assert views is not None
    expected = plain(theirs.transpose(0, 1))
    pull = torch.randn_like(expected)
    loss = (torch.cat([unified[None], views]).transpose(0, 1) * pull).sum()
    loss.backward()
    (expected * pull).sum().backward()
    assert_close(torch.cat([unified[None], views]).transpose(0, 1), expected, atol=1e-4, rtol=1e-4)
    assert_close(ours.grad, theirs.grad, atol=1e-3, rtol=1e-3)
    truth = {name: parameter.grad for name, parameter in plain.named_parameters()}
    for name, parameter in layer.named_parameters():
        same = truth[renamed(f"view_transformers.{name}")[18:]]
        assert same is not None
        assert_close(parameter.grad, same, atol=1e-3 * float(same.abs().max()), rtol=1e-3)


def test_channels_that_heads_cannot_share_are_refused():
    with pytest.raises(ValueError, match="width 10 is not a multiple of 4 heads"):
        ViewTransformer(10, heads=4)
