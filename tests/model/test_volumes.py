"""The mean and variance over views, which the public code gets wrong."""

from __future__ import annotations

import torch
from torch.testing import assert_close

from neugrasp.geometry.sampling import InterpolationIndex
from neugrasp.model.volumes import VolumeNet, masked_mean_and_variance
from neugrasp.training.recipes import tiny


def test_the_mean_over_views_of_a_constant_is_that_constant():
    seen = torch.tensor([[1, 1, 0], [1, 0, 0], [1, 1, 0]], dtype=torch.bool)
    mean, variance = masked_mean_and_variance(torch.full((3, 3, 2), 7.0), seen)
    assert_close(mean[:2], torch.full((2, 2), 7.0))
    assert_close(variance, torch.zeros(3, 2), atol=1e-6, rtol=0)
    assert_close(mean[2], torch.zeros(2))


def test_views_that_do_not_see_a_voxel_do_not_count():
    features = torch.randn(4, 6, 5)
    seen = torch.ones(4, 6, dtype=torch.bool)
    seen[3] = False
    mean, variance = masked_mean_and_variance(features, seen)
    assert_close(mean, features[:3].mean(0))
    assert_close(variance, features[:3].var(0, unbiased=False))


def test_volumes_keep_the_order_of_axes():
    """A feature at one voxel moves the volume there more than anywhere far from it."""
    torch.manual_seed(0)
    net = VolumeNet(tiny().model).eval()
    # A map of 40 x 1600 pixels in which every voxel lies at a pixel of its own.
    rows = torch.arange(2 * 40**3, dtype=torch.int32).reshape(2, -1, 1)
    voxels, seen = InterpolationIndex(rows, torch.ones(rows.shape)), torch.ones(2, 40**3, dtype=torch.bool)
    features = torch.zeros(2, 4, 40, 1600)
    moved = features.clone()
    moved[:, :, 30, 12 * 40 + 5] = 20.0
    change = (net((moved,), voxels, seen) - net((features,), voxels, seen))[0].abs().sum(0)
    peak = torch.nonzero(change == change.max())[0]
    assert (peak - torch.tensor([30, 12, 5])).abs().max() <= 4
