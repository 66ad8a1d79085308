"""The kernel and the plain layer are the same function, values and gradients."""

from __future__ import annotations

import pytest
import torch
from torch.testing import assert_close

from neugrasp.kernels import view_attention
from neugrasp.kernels.view_attention import BLOCK
from neugrasp.model.attention import ViewTransformer


def gradients(layer: ViewTransformer, result: torch.Tensor, tokens: torch.Tensor) -> dict[str, torch.Tensor]:
    """Of a random projection of the result, to the tokens and to every weight."""
    pull = torch.randn(result.shape, generator=torch.Generator().manual_seed(1))
    names, parameters = zip(*layer.named_parameters(), strict=True)
    found = torch.autograd.grad((result * pull).sum(), [tokens, *parameters])
    return dict(zip(("tokens", *names), found, strict=True))


@pytest.mark.parametrize("need_views", [False, True])
def test_it_equals_the_plain_layer(need_views: bool):
    """There are more points than a block holds."""
    torch.manual_seed(0)
    layer = ViewTransformer(12, heads=4)
    tokens = torch.randn(3, BLOCK + 5, 12, requires_grad=True)
    unified, views = layer(tokens, need_views)
    plain = unified[None] if views is None else torch.cat([unified[None], views])
    kernel = view_attention.attend(layer, tokens, len(plain))
    assert_close(kernel, plain, atol=1e-5, rtol=1e-4)
    expected = gradients(layer, plain, tokens)
    for name, gradient in gradients(layer, kernel, tokens).items():
        assert_close(gradient, expected[name], atol=1e-4 * float(expected[name].abs().max()), rtol=1e-3)


def test_it_is_used_in_bfloat16_with_a_gradient_alone(monkeypatch: pytest.MonkeyPatch):
    used = []
    attend = view_attention.attend
    monkeypatch.setattr(view_attention, "attend", lambda *given: used.append(given) or attend(*given))
    layer, tokens = ViewTransformer(12, heads=4), torch.randn(3, 7, 12)
    layer(tokens, need_views=True)
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        layer(tokens.bfloat16(), need_views=True)
    assert not used
    with torch.autocast("cpu", torch.bfloat16):
        layer(tokens.bfloat16(), need_views=True)
    assert len(used) == 1


def test_in_bfloat16_it_is_as_near_to_the_truth_as_the_plain_layer():
    torch.manual_seed(0)
    layer, tokens = ViewTransformer(24, heads=8), torch.randn(4, 300, 24)
    truth = layer(tokens, need_views=False)[0]
    with torch.autocast("cpu", torch.bfloat16):
        kernel = layer(tokens.bfloat16(), need_views=False)[0]
        with torch.no_grad():
            plain = layer(tokens.bfloat16(), need_views=False)[0]
    errors = [float((found.float() - truth).abs().mean().detach()) for found in (kernel, plain)]
    assert errors[0] < 1.5 * errors[1]


def test_a_second_derivative_is_refused_by_name():
    layer, tokens = ViewTransformer(8, heads=2), torch.randn(2, 5, 8, requires_grad=True)
    result = view_attention.attend(layer, tokens, 1).square().sum()
    (gradient,) = torch.autograd.grad(result, tokens, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.sum().backward()
