"""What must hold of the whole network, whatever its weights are."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch.testing import assert_close

from neugrasp.model.field import table_distance
from neugrasp.model.inputs import ViewTensors
from neugrasp.model.network import NeuGrasp
from neugrasp.training.recipes import paper, tiny


def chosen(views: ViewTensors, order: list[int]) -> ViewTensors:
    return ViewTensors(views.images[order], views.backgrounds[order], views.cameras.select(order))


@pytest.mark.slow
@torch.no_grad()
def test_the_order_of_the_views_does_not_matter(model, views):
    first, grasps = model(views)
    second, same_grasps = model(chosen(views, [2, 0, 3, 1]))
    assert_close(first.sdf, second.sdf, atol=1e-4, rtol=1e-4)
    assert_close(grasps.quality, same_grasps.quality, atol=1e-4, rtol=1e-4)


@pytest.mark.slow
@torch.no_grad()
@pytest.mark.parametrize("count", [1, 2, 3, 8])
def test_any_number_of_views_from_one_to_eight_works(model, views, count):
    reconstruction, grasps = model(chosen(views, [i % 4 for i in range(count)]))
    assert reconstruction.sdf.shape == (40, 40, 40)
    assert torch.isfinite(reconstruction.sdf).all()
    assert grasps.rotation.norm(dim=1).allclose(torch.ones(1, 40, 40, 40), atol=1e-5)


@pytest.mark.slow
@torch.no_grad()
def test_the_grid_is_the_field_read_at_the_voxel_centres(model, views):
    """Catches a flipped column, a half voxel, and volumes or maps read with their axes exchanged."""
    reconstruction, _ = model(views)
    centres = torch.from_numpy(model.workspace.voxel_centres()).float()
    columns = centres.reshape(1600, 40, 3)[::97].flip(1)
    expected = model.field(reconstruction.scene.at_points(columns), model.workspace)[0].flip(1)
    assert_close(reconstruction.sdf.reshape(1600, 40)[::97], expected, atol=2e-3, rtol=1e-3)


@torch.no_grad()
def test_some_columns_are_those_of_the_grid(model, views):
    reconstruction, _ = model(views)
    columns = torch.tensor([1599, 0, 41, 900])
    some = model.sdf_columns(reconstruction.scene, columns)
    assert_close(some, reconstruction.sdf.reshape(1600, 40)[columns], atol=1e-5, rtol=1e-5)


@pytest.mark.slow
@torch.no_grad()
def test_points_that_no_view_sees_count_as_outside(model, views):
    far = torch.tensor([[[5.0, 5.0, 0.1], [5.0, 5.0, 0.0]]])
    reconstruction, _ = model(views)
    sdf, _ = model.field(reconstruction.scene.at_points(far), model.workspace)
    assert_close(sdf, torch.ones(1, 2))


def test_the_table_is_where_the_workspace_says(model):
    heights = torch.tensor([0.02, 0.05, 0.065, 0.2])
    assert_close(table_distance(heights, model.workspace), torch.tensor([-1.0, 0.0, 0.5, 1.0]))


@pytest.mark.slow
@torch.no_grad()
def test_blended_colours_lie_between_the_views(model, views):
    flat = ViewTensors(torch.full_like(views.images, 0.25), views.backgrounds, views.cameras)
    reconstruction, _ = model(flat)
    points = torch.rand(6, 5, 3) * 0.1 + 0.1
    samples = reconstruction.scene.at_points(points, colours=True)
    _, features = model.field(samples, model.workspace)
    colour = model.field.blend(samples, features, views.cameras, views.cameras.centres[:1].expand(6, 3))
    assert_close(colour, torch.full((6, 5, 3), 0.25))


@pytest.mark.slow
@torch.no_grad()
@pytest.mark.parametrize(
    "switch", [{"use_residual_attention": False}, {"use_occupancy_prior": False}, {"use_backgrounds": False}]
)
def test_ablations_are_wired_as_the_paper_says(views, switch):
    config = replace(tiny().model, **switch)
    torch.manual_seed(0)
    network = NeuGrasp(config).eval()
    before = network(views)[0].sdf
    other = ViewTensors(views.images, 1 - views.backgrounds, views.cameras)
    sees_background = not torch.allclose(before, network(other)[0].sdf, atol=1e-6)
    assert sees_background == config.use_backgrounds


def test_the_paper_model_has_about_the_papers_number_of_parameters():
    """2.832 M in the released code; one more blending layer, group instead of batch norm."""
    count = sum(parameter.numel() for parameter in NeuGrasp(paper().model).parameters())
    assert abs(count - 2_832_000) < 5_000
