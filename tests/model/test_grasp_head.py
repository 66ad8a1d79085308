"""The grasp head's shortcut through equal voxels."""

from __future__ import annotations

import pytest
import torch
import torch.nn.functional as F
from torch import nn
from torch.testing import assert_close

from neugrasp.model.grasp_head import convolve_doubled


@pytest.mark.parametrize("kernel", [3, 5])
def test_convolving_doubled_voxels_is_doubling_and_then_convolving(kernel: int):
    torch.manual_seed(0)
    layers = [nn.Conv3d(3, outputs, kernel, padding=kernel // 2) for outputs in (2, 1)]
    x = torch.randn(2, 3, 4, 5, 6)
    doubled = F.interpolate(x, scale_factor=2, mode="nearest")
    expected = torch.cat([layer(doubled) for layer in layers], dim=1)
    assert_close(convolve_doubled(x, *layers), expected, atol=1e-5, rtol=1e-4)
