"""What GraspNeRF minimises: colour, depth, TSDF, Eikonal, grasp; each where its weight is not 0."""

from __future__ import annotations

import torch
from torch import Tensor

from neugrasp.baselines.graspnerf.network import GraspNerf
from neugrasp.baselines.graspnerf.scene import PhotographedScene
from neugrasp.baselines.graspnerf.visibility import scaled_inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.rendering import Rays, cut_to_workspace
from neugrasp.training.config import TrainConfig
from neugrasp.training.dataset import Batch
from neugrasp.training.losses import eikonal_loss, grasp_loss, photometric_loss, tsdf_loss
from neugrasp.training.module import Losses, head_loss, some_views, total
from neugrasp.training.networks import NetworkSpec, judge_surface
from neugrasp.training.samples import Photos, Sample

DEPTH_PIXELS = 1024
"""Pixels of each input view, for the loss of depth; the original takes 8192 of photos twice as large."""


def graspnerf_losses(
    network: GraspNerf, batch: Batch, config: TrainConfig, step: int, generator: torch.Generator
) -> Losses:
    """The terms by name, and their weighted sum as "loss"."""
    if not batch.samples:
        losses = {"grasp": head_loss(network.head, batch.truths, False, generator)}
    else:
        each = [_losses_of(network, sample, config, step, generator) for sample in batch.samples]
        losses = {name: torch.stack([one[name] for one in each]).mean() for name in each[0]}
        if config.weights.rehearsal:
            losses["rehearsal"] = head_loss(network.head, batch.truths, False, generator)
    return {"loss": total(losses, config), **losses}


def _losses_of(
    network: GraspNerf, sample: Sample, config: TrainConfig, step: int, generator: torch.Generator
) -> Losses:
    weights, workspace = config.weights, network.workspace
    inputs = some_views(sample.inputs, config, generator)
    scene = network.encode(inputs.views)
    x, y = _window(workspace, config, step, generator)
    sdf, seen = network.sdf_window(scene, x, y)
    losses: Losses = {}
    if weights.grasp and sdf.shape[0] == sdf.shape[1] == workspace.resolution:
        losses["grasp"] = grasp_loss(network.head(sdf.clamp(-1, 1).unsqueeze(0)), [sample.truth.labels])
    if weights.eikonal:
        losses["eikonal"] = eikonal_loss(sdf, seen, workspace)
    if weights.tsdf:
        losses["tsdf"] = tsdf_loss(
            sdf, sample.truth.needed("tsdf")[x, y], sample.truth.needed("observed")[x, y]
        )
    if weights.depth:
        losses["depth"] = depth_loss(network, scene, inputs, generator)
    if weights.photometric:
        losses["photometric"] = _colour_loss(network, scene, sample.targets, config.rays, generator)
    return losses


def _window(
    workspace: Workspace, config: TrainConfig, step: int, generator: torch.Generator
) -> tuple[slice, slice]:
    """Which columns of voxels a step asks for: all, or a random square of them in most steps."""
    edge = workspace.resolution
    side = round(config.columns**0.5)
    if not 0 < side < edge or (step - config.head_steps) % config.whole_every == 0:
        return slice(edge), slice(edge)
    x, y = torch.randint(edge - side + 1, (2,), generator=generator).tolist()
    return slice(x, x + side), slice(y, y + side)


def depth_loss(
    network: GraspNerf, scene: PhotographedScene, photos: Photos, generator: torch.Generator
) -> Tensor:
    """Mean squared error of where rays of the input views end, coarse and fine, on the scale of `RayEnds`.

    Pixels without a depth, or with one beyond the scale, do not count.
    """
    if photos.depths is None:
        raise ValueError("the photos have no depths")
    num, height, width = photos.depths.shape
    places = torch.randint(height * width, (num, DEPTH_PIXELS), generator=generator).to(photos.depths.device)
    pixels = torch.stack([places % width, places // width], dim=-1).float()
    depths = photos.depths.flatten(1).gather(1, places)
    config = network.config
    truth = scaled_inverse(depths, config.nearest, config.farthest)
    counts = (truth >= 0) & (truth <= 1)
    rays = scene.cameras.interpolation(pixels, scene.map_shape).read(scene.maps).chunk(2, dim=-1)[1]
    errors = [(reader.ends(rays).mean - truth).square() for reader in (network.coarse, network.fine)]
    return ((errors[0] + errors[1]) * counts).sum() / counts.sum().clamp(min=1)


def _colour_loss(
    network: GraspNerf, scene: PhotographedScene, targets: Photos, num: int, generator: torch.Generator
) -> Tensor:
    """Photometric loss of rays of one target view, coarse and fine; nothing shines from behind the scene."""
    view = int(torch.randint(len(targets.changes), (), generator=generator))
    rays, row, column = rays_to_the_table(network.workspace, targets, view, num, generator)
    colour = targets.views.images[view, :, row, column].T
    rendered = network.render(scene, rays, network.sharpness(), generator)
    return torch.stack([photometric_loss(one, colour, torch.zeros_like(colour)) for one in rendered]).sum()


def rays_to_the_table(
    workspace: Workspace, photos: Photos, view: int, num: int, generator: torch.Generator
) -> tuple[Rays, Tensor, Tensor]:
    """Up to `num` rays of one view that meet the table inside the cube, with their rows and columns.

    All that such a ray sees is inside: no photo of the empty table is needed to know what lies behind.
    """
    height, width = photos.changes.shape[1:]
    candidates = torch.randint(height * width, (4 * num,), generator=generator).to(photos.changes.device)
    row, column = candidates // width, candidates % width
    pixels = torch.stack([column, row], dim=1).float()
    rays = cut_to_workspace(*photos.views.cameras.rays(view, pixels), workspace)
    distance = (workspace.table_height - rays.origins[:, 2]) / rays.directions[:, 2]
    left, top, right, bottom = photos.views.cameras.bounds[view]
    measured = (column > left) & (column < right) & (row > top) & (row < bottom)
    meets = (distance > rays.near) & (distance < rays.far) & measured
    chosen = torch.nonzero(meets).squeeze(1)[:num]
    return rays.select(chosen), row[chosen], column[chosen]


NETWORK = NetworkSpec(GraspNerf, graspnerf_losses, judge_surface, compares=False)
