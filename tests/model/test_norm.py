"""Normalisation where channels lie last: as exact as PyTorch's own where they come first."""

from __future__ import annotations

import pytest
import torch
import torch.nn.functional as F

from neugrasp.model.norm import SMALL, GroupNorm


@pytest.mark.parametrize("shape", [(2, 16, 12, 12, 12), (3, 8, 40, 44), (2, 8, 8, 8)], ids=str)
@pytest.mark.parametrize("wanted", [True, False], ids=["gradient", "none"])
@pytest.mark.parametrize("groups", [1, 2, 8])
def test_a_large_mean_costs_no_digits(shape: tuple[int, ...], wanted: bool, groups: int):
    """Means thirty deviations large: a difference of two sums in float32 would be off by 1e-3."""
    torch.manual_seed(0)
    layer = GroupNorm(groups, shape[1])
    torch.nn.init.normal_(layer.weight)
    order = torch.channels_last if len(shape) == 4 else torch.channels_last_3d
    x = (torch.randn(shape) + 30).contiguous(memory_format=order)
    exact = F.group_norm(x.double(), groups, layer.weight.double(), layer.bias.double(), layer.eps)
    with torch.set_grad_enabled(wanted):
        found = layer(x)
    assert found.is_contiguous(memory_format=order)
    assert (found - exact).abs().max() < 1e-4


def test_large_and_small_maps_are_both_tried():
    assert 8 * 8 < SMALL < min(12**3, 40 * 44)
