"""The plain implementation and the network are the same function of the same weights."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from neugrasp.bench.workloads import bundled_views, fresh_model
from neugrasp.model.config import ModelConfig
from neugrasp.model.inputs import ViewTensors, prepare
from neugrasp.model.network import NeuGrasp
from neugrasp.model.rendering import cut_to_workspace
from neugrasp.training.recipes import paper, small, tiny
from reference_network.network import ReferenceNetwork

pytestmark = pytest.mark.slow

TOLERANCE = 1e-4
"""Relative, on the signed distance: float32 has 24 bits, and the sums are long."""


def relative_error(value: Tensor, truth: Tensor) -> float:
    """The largest deviation over the largest value."""
    difference, scale = (value - truth).detach(), truth.detach()
    return float(difference.abs().max() / scale.abs().max())


def photos(size: int, num: int = 4) -> ViewTensors:
    return prepare(bundled_views(num), size)


def lively(config: ModelConfig) -> NeuGrasp:
    """Random weights, with norms and biases that do something."""
    model = fresh_model(config, seed=3).eval()
    generator = torch.Generator().manual_seed(4)
    with torch.no_grad():
        for parameter in model.parameters():
            if parameter.dim() == 1:
                parameter += 0.2 * torch.randn(parameter.shape, generator=generator)
    return model


CONFIGS = {
    "tiny": (tiny().model, 64, 4),
    "tiny, one view": (tiny().model, 64, 1),
    "tiny, w/o change": (replace(tiny().model, use_change=False), 64, 2),
    "tiny, w/o f_attn": (replace(tiny().model, use_residual_attention=False), 64, 3),
    "tiny, w/o V_occ": (replace(tiny().model, use_occupancy_prior=False), 64, 3),
    "tiny, w/o backgrounds": (replace(tiny().model, use_backgrounds=False), 64, 3),
    "small": (small().model, 128, 4),
}


@torch.no_grad()
@pytest.mark.parametrize("name", CONFIGS)
def test_signed_distances_and_grasps_are_those_of_the_reference(name: str):
    config, size, num = CONFIGS[name]
    model, views = lively(config), photos(size, num)
    reference = ReferenceNetwork(model)
    truth = reference.reconstruct(reference.encode(views.images), reference.encode_backgrounds(views), views)
    ours, grasps = model(views)
    assert relative_error(ours.sdf, truth.sdf) < TOLERANCE
    assert_close(ours.seen, truth.seen)
    same_grasps = reference.head(ours.tsdf.unsqueeze(0))
    for value in ("quality", "rotation", "width"):
        assert relative_error(getattr(grasps, value), getattr(same_grasps, value)) < TOLERANCE


@pytest.mark.slow
@torch.no_grad()
def test_the_papers_shapes_agree_too():
    model, views = lively(paper().model), photos(256)
    reference = ReferenceNetwork(model)
    truth = reference.reconstruct(reference.encode(views.images), reference.encode_backgrounds(views), views)
    assert relative_error(model(views)[0].sdf, truth.sdf) < TOLERANCE


def test_renderings_and_their_gradients_are_those_of_the_reference():
    model, views = lively(tiny().model), photos(64)
    reference = ReferenceNetwork(model)
    pixels = torch.rand((40, 2), generator=torch.Generator().manual_seed(1)) * 63
    rays = cut_to_workspace(*views.cameras.rays(0, pixels), model.workspace)
    gradients = []
    renderings = []
    for network in (model, reference):
        maps, empty = network.encode(views.images), network.encode_backgrounds(views)
        scene = network.reconstruct(maps, empty, views).scene
        rendered = network.render(scene, rays, network.sharpness(120.0))
        renderings.append(rendered)
        loss = torch.stack([one.colour.square().sum() + one.depth.sum() for one in rendered]).sum()
        gradients.append(torch.autograd.grad(loss, list(network.features.parameters())))
    for ours, theirs in zip(*renderings, strict=True):
        assert relative_error(ours.colour, theirs.colour) < TOLERANCE
        assert relative_error(ours.depth, theirs.depth) < TOLERANCE
    scale = max(float(gradient.abs().max()) for gradient in gradients[1])
    for ours, theirs in zip(*gradients, strict=True):
        assert float((ours - theirs).abs().max()) < 1e-3 * scale
