"""What the network makes of a photo and its background."""

from __future__ import annotations

import pytest
import torch
from torch import nn
from torch.testing import assert_close

from neugrasp.model.features import ImageDifference, ResidualAttention, StridedPointwise


@torch.no_grad()
def test_features_of_the_change_are_zero_where_nothing_changed() -> None:
    table = torch.rand(1, 3, 64, 64)
    scene = table.clone()
    scene[:, :, :20, :20] = torch.tensor([0.9, 0.1, 0.0]).reshape(1, 3, 1, 1)
    change = ImageDifference(8)(scene, table)
    assert change.shape == (1, 8, 16, 16)
    assert change[:, :, 7:].abs().max() == 0
    assert change[:, :, :, 7:].abs().max() == 0
    assert change[:, :, :5, :5].abs().mean() > 0.01


@torch.no_grad()
def test_where_nothing_changed_the_gate_starts_at_one_value() -> None:
    residual = ResidualAttention(8)
    features = torch.randn(2, 8, 16, 16)
    gate = torch.sigmoid(residual.gate(torch.zeros(2, 8, 16, 16)))
    expected = residual.out(residual.value(residual.key(features)) * gate)
    assert_close(residual(features, features), expected)
    assert (residual(features, torch.zeros_like(features)) - expected).abs().mean() > 0.01


@pytest.mark.parametrize("size", [(16, 12), (15, 13)])
@pytest.mark.parametrize("step", [1, 2])
def test_picking_pixels_before_a_pointwise_convolution_is_a_stride(size: tuple[int, int], step: int) -> None:
    picked = StridedPointwise(4, 6, step)
    strided = nn.Conv2d(4, 6, 1, step, bias=False)
    strided.load_state_dict(picked.state_dict())
    weights = torch.randn(1, 6, 16, 16)
    grads = []
    for convolution in (picked, strided):
        x = torch.linspace(-1, 1, 2 * 4 * size[0] * size[1]).reshape(2, 4, *size).requires_grad_()
        out = convolution(x)
        (out * weights[..., : out.shape[-2], : out.shape[-1]]).sum().backward()
        grads.append((out, x.grad, convolution.weight.grad))
    for mine, theirs in zip(*grads, strict=True):
        assert_close(mine, theirs)
