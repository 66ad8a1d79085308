"""GraspNeRF's own mappings: where rays end, what views say together, and that nothing else is seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from ball_record import ball_record
from neugrasp.baselines.graspnerf.aggregation import RayAttention, weighted_moments
from neugrasp.baselines.graspnerf.config import GraspNerfConfig
from neugrasp.baselines.graspnerf.losses import depth_loss, graspnerf_losses, rays_to_the_table
from neugrasp.baselines.graspnerf.network import GraspNerf
from neugrasp.baselines.graspnerf.recipes import paper, tiny, tiny_without
from neugrasp.baselines.graspnerf.visibility import RayEndDecoder, RayEnds, scaled_inverse, scaled_length
from neugrasp.data.grasp_scene import GraspScene
from neugrasp.geometry.workspace import USUAL
from neugrasp.training.dataset import Batch, Scenes
from neugrasp.training.module import Losses
from neugrasp.training.samples import Sample, drop_views
from neugrasp.training.state import TrainState

RAYS = st.integers(1, 20)


class OneRecord:
    """A data set of one ball."""

    def __len__(self) -> int:
        return 1

    def scene(self, *_: object) -> GraspScene:
        return ball_record(x=0.13, y=0.16).grasp_scene()

    def has_photos(self, _index: int) -> bool:
        return True

    def has_truth(self, _index: int) -> bool:
        return True


@pytest.fixture(scope="module")
def sample() -> Sample:
    scenes = Scenes([(OneRecord(), 0)], 64, finds_changes=False, reads_depths=True)  # type: ignore[list-item]
    return scenes.sample(0, None)


@pytest.fixture
def network() -> GraspNerf:
    torch.manual_seed(0)
    return GraspNerf(tiny().model)  # type: ignore[arg-type]


def some_ends(seed: int, num: int) -> RayEnds:
    torch.manual_seed(seed)
    with torch.no_grad():
        return RayEndDecoder(8)(3 * torch.randn(num, 8))


@pytest.mark.slow
@given(st.integers(0, 2**31), RAYS)
def test_the_chance_that_a_ray_ends_somewhere_is_one(seed: int, num: int):
    """Far before and far beyond everything; between them it never falls."""
    ends = some_ends(seed, num)
    wide = 40 / float(ends.steepness.min()) + float(ends.means.max())
    places = torch.linspace(-wide, wide, 4001).unsqueeze(1).expand(-1, num)
    before = RayEnds(
        *(each.expand(4001, num, 2) for each in (ends.means, ends.steepness, ends.shares))
    ).before(places)
    assert torch.allclose(before[0], torch.zeros(num), atol=1e-5)
    assert torch.allclose(before[-1], torch.ones(num), atol=1e-5)
    assert (before.diff(dim=0) >= -1e-6).all()


@pytest.mark.slow
@given(st.integers(0, 2**31), RAYS, st.floats(-1, 2), st.floats(0, 0.5))
def test_no_ray_ends_where_it_does_not_come(seed: int, num: int, place: float, length: float):
    reached, hit = some_ends(seed, num).seen_and_hit(torch.full((num,), place), torch.full((num,), length))
    assert ((reached >= 0) & (reached <= 1)).all()
    assert (hit >= -1e-6).all()
    assert (hit <= reached + 1e-6).all()


def test_the_mean_is_where_half_the_rays_of_one_logistic_end():
    ends = RayEnds(torch.tensor([[0.3, 0.7]]), torch.tensor([[50.0, 50.0]]), torch.tensor([[1.0, 0.0]]))
    assert ends.mean.item() == pytest.approx(0.3)
    assert ends.before(ends.mean).item() == pytest.approx(0.5)


@pytest.mark.slow
def test_inverse_depth_runs_from_nearest_to_farthest():
    depths = torch.tensor([0.2, 0.32, 0.8])
    places = scaled_inverse(depths, 0.2, 0.8)
    torch.testing.assert_close(places, torch.tensor([0.0, 0.5, 1.0]))
    step = 1e-3
    ends = scaled_inverse(torch.tensor([0.4 - step / 2, 0.4 + step / 2]), 0.2, 0.8)
    length = scaled_length(torch.tensor(step), torch.tensor(0.4), 0.2, 0.8)
    assert length.item() == pytest.approx((ends[1] - ends[0]).item(), rel=1e-2)


def test_moments_of_a_constant_are_that_constant_and_zero():
    weights = torch.rand(4, 7, 1)
    mean, variance = weighted_moments(torch.full((4, 7, 3), 2.5), weights / weights.sum(0))
    torch.testing.assert_close(mean, torch.full((7, 3), 2.5))
    torch.testing.assert_close(variance, torch.zeros(7, 3), atol=1e-10, rtol=0)


def test_samples_that_are_not_told_hear_nothing_of_the_others():
    torch.manual_seed(0)
    attention, x = RayAttention(8, 2), torch.randn(3, 5, 8)
    told = torch.ones(3, 5, dtype=torch.bool)
    told[:, 2] = False
    other = x.clone()
    other[:, 4] += 1
    before, after = attention(x, told), attention(other, told)
    torch.testing.assert_close(before[:, 2], after[:, 2])
    assert not torch.allclose(before[:, 1], after[:, 1])


@pytest.mark.slow
@torch.no_grad()
def test_the_order_of_the_views_does_not_matter(network: GraspNerf, sample: Sample):
    turned = drop_views(sample.inputs, [2, 0, 3, 1])
    one, other = (network(photos.views)[0].sdf for photos in (sample.inputs, turned))
    torch.testing.assert_close(one, other, atol=1e-4, rtol=1e-4)


@pytest.mark.slow
@torch.no_grad()
def test_it_sees_no_backgrounds(network: GraspNerf, sample: Sample):
    views = sample.inputs.views
    blind = replace(views, backgrounds=torch.full_like(views.backgrounds, float("nan")))
    assert torch.equal(network(views)[0].sdf, network(blind)[0].sdf)


@pytest.mark.slow
@torch.no_grad()
def test_a_window_is_a_part_of_the_grid(network: GraspNerf, sample: Sample):
    scene = network.encode(sample.inputs.views)
    whole = network.reconstruct(scene)
    sdf, seen = network.sdf_window(scene, slice(3, 9), slice(20, 33))
    torch.testing.assert_close(sdf, whole.sdf[3:9, 20:33], atol=1e-5, rtol=1e-4)
    assert torch.equal(seen, whole.seen[3:9, 20:33])


@torch.no_grad()
def test_depth_costs_nothing_where_rays_end_where_they_should(network: GraspNerf, sample: Sample):
    """A scene whose ray features are the true places themselves, and decoders that repeat them."""
    photos, scene = sample.inputs, network.encode(sample.inputs.views)
    assert photos.depths is not None
    config = network.config
    flat = replace(photos, depths=torch.full_like(photos.depths, 0.4))
    truth = float(scaled_inverse(torch.tensor(0.4), config.nearest, config.farthest))

    class Told(torch.nn.Module):
        def forward(self, rays: Tensor) -> RayEnds:
            means = torch.full((*rays.shape[:-1], 2), truth)
            return RayEnds(means, torch.ones_like(means), torch.full_like(means, 0.5))

    before = depth_loss(network, scene, flat, torch.Generator())
    network.coarse.ends = network.fine.ends = Told()  # type: ignore[assignment]
    assert depth_loss(network, scene, flat, torch.Generator()) < 1e-12 < before
    nothing = replace(photos, depths=torch.zeros_like(photos.depths))
    assert depth_loss(network, scene, nothing, torch.Generator()) == 0


def test_rays_of_the_colour_loss_meet_the_table_inside_the_cube(sample: Sample):
    rays, row, column = rays_to_the_table(USUAL, sample.targets, 0, 200, torch.Generator().manual_seed(0))
    assert len(row) == len(column) > 50
    distance = (USUAL.table_height - rays.origins[:, 2:]) / rays.directions[:, 2:]
    assert USUAL.contains(rays.points(distance)[:, 0].numpy() + np.array([0, 0, 1e-4])).all()


def test_true_depths_agree_with_the_cameras(sample: Sample):
    """The pixel of the ball's top shows the depth of the ball's top."""
    photos = sample.inputs
    assert photos.depths is not None
    top = torch.tensor([[0.13, 0.16, USUAL.table_height + 0.06]])
    pixels, _ = photos.views.cameras.project(top)
    depths = photos.views.cameras.depths(top)[:, 0]
    for view, (column, row) in enumerate(pixels[:, 0].round().long().tolist()):
        assert photos.depths[view, row, column].item() == pytest.approx(depths[view].item(), abs=0.01)


@pytest.mark.slow
def test_nothing_that_knows_geometry_is_asked_without_tsdf(network: GraspNerf, sample: Sample):
    """Neither depth nor TSDF of the scene move the loss."""
    config = tiny_without()
    other = replace(sample, truth=replace(sample.truth, tsdf=torch.zeros_like(sample.truth.tsdf)))
    other = replace(other, inputs=replace(sample.inputs, depths=None))
    first, second = (
        graspnerf_losses(network, Batch((one,), ()), config, 0, torch.Generator().manual_seed(1))
        for one in (sample, other)
    )
    assert first.keys() == {"loss", "grasp", "eikonal", "photometric"}
    assert torch.equal(first["loss"], second["loss"])


@pytest.mark.slow
def test_losses_in_bfloat16_are_nearly_the_same(network: GraspNerf, sample: Sample):
    """Geometry, distributions and opacity stay float32."""
    config = replace(tiny(), weights=replace(tiny().weights, rehearsal=0.0))

    def losses() -> Losses:
        return graspnerf_losses(network, Batch((sample,), ()), config, 2, torch.Generator().manual_seed(1))

    exact = losses()
    with torch.autocast("cpu", torch.bfloat16):
        reduced = losses()
    reduced["loss"].backward()
    for name, value in exact.items():
        assert reduced[name].item() == pytest.approx(value.item(), rel=0.02), name
    gradients = [weight.grad for weight in network.parameters() if weight.grad is not None]
    assert gradients
    assert all(torch.isfinite(gradient).all() for gradient in gradients)


@pytest.mark.slow
def test_the_originals_widths_run():
    """The original's reconstruction has 4.34 million weights; ours is made of the project's blocks."""
    config = paper().model
    assert isinstance(config, GraspNerfConfig)
    network = GraspNerf(replace(config, image_size=64))
    count = sum(weight.numel() for name, weight in network.named_parameters() if "head" not in name)
    assert 4.30e6 < count < 4.40e6
    scenes = Scenes([(OneRecord(), 0)], 64, finds_changes=False)  # type: ignore[list-item]
    with torch.no_grad():
        reconstruction, volume = network(scenes.sample(0, None).inputs.views)
    assert reconstruction.sdf.shape == volume.quality[0].shape == (40, 40, 40)


@pytest.mark.slow
def test_one_scene_is_learned_by_heart(sample: Sample):
    """With TSDF and depth, the surface comes within a fifth of the truncation of the true one."""
    torch.manual_seed(0)
    weights = replace(tiny().weights, rehearsal=0.0)
    config = replace(
        tiny(), weights=weights, head_steps=0, columns=144, whole_every=1_000, steps=80, view_dropout=0.0
    )
    network = GraspNerf(config.model)  # type: ignore[arg-type]
    learner = TrainState.of(network, config)
    for group in learner.optimizer.param_groups:
        group["lr"] = 5e-3
    for step in range(config.steps):
        generator = torch.Generator().manual_seed(step)
        graspnerf_losses(network, Batch((sample,), ()), config, step, generator)["loss"].backward()
        learner.update(1.0)
    with torch.no_grad():
        sdf = network(sample.inputs.views)[0].tsdf
    near = sample.truth.tsdf.abs() < 0.5
    assert (sdf - sample.truth.tsdf)[near].abs().mean() < 0.2
