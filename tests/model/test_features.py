"""What the network makes of a photo and its background."""

from __future__ import annotations

import torch
from torch.testing import assert_close

from neugrasp.model.features import ChangeFeatures, ResidualAttention


@torch.no_grad()
def test_features_of_the_change_are_zero_where_nothing_changed() -> None:
    table = torch.rand(1, 3, 64, 64)
    scene = table.clone()
    scene[:, :, :20, :20] = torch.tensor([0.9, 0.1, 0.0]).reshape(1, 3, 1, 1)
    change = ChangeFeatures(8)(scene, table)
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
