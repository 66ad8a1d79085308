"""NeuS rendering against closed forms."""

from __future__ import annotations

import pytest
import torch
from torch.testing import assert_close

from neugrasp.geometry.workspace import Workspace
from neugrasp.model.rendering import (
    composite,
    cut_to_workspace,
    importance_samples,
    neus_alpha,
    ray_weights,
    stratified_samples,
)


def rays_down(num: int):
    """Vertical rays over the middle of the cube, a little apart."""
    x = torch.linspace(0.10, 0.20, num)
    origins = torch.stack([x, torch.full_like(x, 0.15), torch.full_like(x, 0.6)], 1)
    return origins, torch.tensor([0.0, 0, -1]).expand_as(origins)


def test_a_vertical_ray_enters_at_the_top_and_leaves_under_the_table():
    rays = cut_to_workspace(*rays_down(3), Workspace())
    assert_close(rays.near, torch.full((3,), 0.30))
    assert_close(rays.far, torch.full((3,), 0.57))


def test_a_ray_beside_the_cube_misses_it():
    rays = cut_to_workspace(torch.tensor([[0.4, 0.15, 0.6]]), torch.tensor([[0.0, 0, -1]]), Workspace())
    assert rays.far[0] <= rays.near[0]


@pytest.mark.parametrize("radius", [0.03, 0.06])
def test_a_rendered_sphere_has_its_known_depth_and_colour(radius):
    rays = cut_to_workspace(*rays_down(21), Workspace())
    centre = torch.tensor([0.15, 0.15, 0.12])
    sdf = lambda at: (rays.points(at) - centre).norm(dim=-1) - radius  # noqa: E731
    coarse_at = stratified_samples(rays, 64, None)
    coarse = ray_weights(sdf(coarse_at), torch.tensor(1000.0))
    at = importance_samples(coarse_at, coarse, 64, None)
    colour = torch.tensor([0.2, 0.5, 0.8]).expand(21, 64, 3)
    rendered = composite(sdf(at), colour, at, torch.tensor(1000.0))
    beside = (rays.origins[:, 0] - 0.15).abs()
    hit, miss = beside < 0.7 * radius, beside > radius + 0.01
    expected = 0.6 - 0.12 - (radius**2 - beside**2).clamp(min=0).sqrt()
    assert_close(rendered.depth[hit], expected[hit], atol=1.5e-3, rtol=0)
    assert_close(rendered.colour[hit], colour[hit, 0], atol=0.02, rtol=0)
    assert (rendered.opacity[hit] > 0.98).all()
    assert (rendered.opacity[miss] < 0.02).all()


def test_leaving_matter_is_not_opaque():
    sdf = torch.tensor([[-0.02, -0.01, 0.01, 0.02]])
    assert_close(neus_alpha(sdf, torch.tensor(500.0)), torch.zeros(1, 3))


def test_weights_are_a_share_of_one():
    sdf = torch.randn(50, 20) * 0.05
    weights = ray_weights(sdf, torch.tensor(200.0))
    assert (weights >= 0).all()
    assert (weights.sum(1) <= 1 + 1e-5).all()


def test_fine_samples_gather_where_the_weights_are():
    distances = torch.linspace(0, 1, 11).unsqueeze(0)
    weights = torch.zeros(1, 10)
    weights[0, 7] = 1
    fine = importance_samples(distances, weights, 100, None)
    assert ((fine >= 0.7) & (fine <= 0.8)).float().mean() > 0.95
    assert (fine.diff() >= 0).all()


def test_jittered_samples_stay_in_order_and_in_range():
    rays = cut_to_workspace(*rays_down(5), Workspace())
    distances = stratified_samples(rays, 30, torch.Generator().manual_seed(3))
    assert (distances.diff() >= 0).all()
    assert (distances >= rays.near[:, None]).all()
    assert (distances <= rays.far[:, None]).all()
