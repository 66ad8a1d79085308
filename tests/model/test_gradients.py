"""Gradients reach everything that the field reads: points, cameras and photos, not only weights."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from neugrasp.model.inputs import ViewTensors
from neugrasp.model.network import NeuGrasp
from neugrasp.model.rendering import Rays, cut_to_workspace

pytestmark = pytest.mark.slow

STEP = 2e-3
"""Of a unit vector: float32 has 24 bits, and the network has kinks."""


def slope(function, at: Tensor, direction: Tensor, step: float) -> float:
    """By central differences."""
    with torch.no_grad():
        return float((function(at + step * direction) - function(at - step * direction)) / (2 * step))


def agrees(function, at: Tensor, step: float = STEP) -> None:
    """The length of the gradient is the slope along it."""
    at = at.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(function(at), at)
    length = gradient.norm()
    assert length > 1e-3
    assert float(length) == pytest.approx(slope(function, at.detach(), gradient / length, step), rel=0.05)


def points_inside() -> Tensor:
    """Two rays of three points above the table."""
    flat = torch.rand(2, 3, 3, generator=torch.Generator().manual_seed(1))
    return 0.1 + 0.08 * flat


def scene_of(model: NeuGrasp, views: ViewTensors):
    return model.reconstruct(model.encode(views.images), model.encode_backgrounds(views), views).scene


def test_of_the_signed_distance_to_the_points(model: NeuGrasp, views: ViewTensors):
    with torch.no_grad():
        scene = scene_of(model, views)
    agrees(lambda at: model.field(scene.at_points(at), model.workspace)[0].sum(), points_inside())


def test_of_the_signed_distance_to_a_cameras_place(model: NeuGrasp, views: ViewTensors):

    def field(pose: Tensor) -> Tensor:
        moved = replace(views.cameras, camera_from_workspace=pose)
        scene = scene_of(model, replace(views, cameras=moved))
        return model.field(scene.at_points(points_inside()), model.workspace)[0].sum()

    # A millimetre is half a pixel, and between pixels the maps have kinks.
    agrees(field, views.cameras.camera_from_workspace, step=3e-4)


def test_of_the_blended_colours_to_the_photos(model: NeuGrasp, views: ViewTensors):
    """Not of a rendering: where the distance rises along a ray, its opacity has a kink at zero."""

    def blended(images: Tensor) -> Tensor:
        samples = scene_of(model, replace(views, images=images)).at_points(points_inside(), colours=True)
        _, features = model.field(samples, model.workspace)
        return model.field.blend(samples, features, views.cameras, views.cameras.centres[:2]).sum()

    agrees(blended, views.images)


@torch.no_grad()
def test_rays_of_two_cameras_in_one_call_are_rendered_as_alone(model: NeuGrasp, views: ViewTensors):
    pixels = torch.tensor([[30.0, 30.0], [20.0, 40.0], [44.0, 25.0]])
    scene = scene_of(model, views)
    alone = [cut_to_workspace(*views.cameras.rays(view, pixels), model.workspace) for view in (0, 3)]
    parts = zip(*((rays.origins, rays.directions, rays.near, rays.far) for rays in alone), strict=True)
    together = model.render(scene, Rays(*(torch.cat(part) for part in parts)), torch.tensor(100.0))[0]
    expected = [model.render(scene, rays, torch.tensor(100.0))[0].colour for rays in alone]
    torch.testing.assert_close(together.colour, torch.cat(expected))
