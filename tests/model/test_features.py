"""The encoder, and what it makes of a photo and its background."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch.testing import assert_close

from neugrasp.model.features import FeatureNet, ResidualAttention
from neugrasp.training.recipes import tiny


@torch.no_grad()
def test_an_object_does_not_change_the_features_of_the_table_far_from_it() -> None:
    """Or else every pixel differs from its background; with the paper's normalisation it does."""
    torch.manual_seed(0)
    table = 0.5 + 0.02 * torch.randn(1, 3, 256, 256)
    scene = table.clone()
    scene[:, :, :40, :40] = torch.tensor([0.9, 0.1, 0.0]).reshape(1, 3, 1, 1)
    pixel = FeatureNet(tiny().model)
    difference = (pixel(scene) - pixel(table)).abs()
    assert difference[:, :, 48:, 48:].max() == 0
    assert difference[:, :, :8, :8].mean() > 0.005
    instance = FeatureNet(replace(tiny().model, encoder_norm="instance"))
    assert (instance(scene) - instance(table))[:, :, 48:, 48:].abs().mean() > 0.005


@torch.no_grad()
def test_where_nothing_changed_the_gate_starts_at_one_value() -> None:
    residual = ResidualAttention(8)
    features = torch.randn(2, 8, 16, 16)
    gate = torch.sigmoid(residual.gate(torch.zeros(2, 8, 16, 16)))
    expected = residual.out(residual.value(residual.key(features)) * gate)
    assert_close(residual(features, features), expected)
    assert (residual(features, torch.zeros_like(features)) - expected).abs().mean() > 0.01
