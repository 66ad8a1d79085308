"""What a step computes: a batch in, named losses out, in one module that DDP and compile can wrap."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

from neugrasp.change_mask import TABLE
from neugrasp.model.field import EncodedViews
from neugrasp.model.network import NeuGrasp, Reconstruction
from neugrasp.model.rendering import Rays, cut_to_workspace
from neugrasp.training.config import TrainConfig
from neugrasp.training.dataset import Batch
from neugrasp.training.losses import (
    carving_loss,
    distance_loss,
    eikonal_loss,
    grasp_loss,
    occupancy_loss,
    photometric_loss,
    table_loss,
    tsdf_loss,
)
from neugrasp.training.samples import Photos, Sample, Truth, drop_views

Losses = dict[str, Float[Tensor, ""]]

CELL = 8
"""Pixels along a cell: what lies 8 to 16 pixels from an object still bounds its outline."""


def bfloat16_pays(device: torch.device) -> bool:
    """Whether products in bfloat16 are faster than in float32: a processor without AVX-512 takes four to
    five times as long for a step in it (docs/training_log.md, "Arithmetic")."""
    return device.type != "cpu" or torch.backends.cpu.get_cpu_capability() == "AVX512"


class NetworkLosses(Protocol):
    """What is minimised."""

    def __call__(
        self, network: Any, batch: Batch, config: TrainConfig, step: int, generator: torch.Generator, /
    ) -> Losses:
        """Terms by name, means over the batch's scenes, and what is minimised as "loss"; everything random
        in them is drawn from the generator."""
        ...


class TrainingModule(nn.Module):
    """A network and its losses: `forward` is all that a training loop calls."""

    def __init__(self, network: nn.Module, losses: NetworkLosses, config: TrainConfig, rank: int = 0):
        super().__init__()
        self.network = network
        self.losses = losses
        self.config = config
        self.rank = rank

    def forward(self, batch: Batch, step: int) -> Losses:
        """The terms of the loss by name, and what is minimised as "loss"; means over the batch's scenes.

        Everything random in them follows from the seed, the step and the rank.
        """
        # A prime apart, so that no rank draws what another does a few steps later.
        seed = self.config.seed * 1_000_003 + step + self.rank * 15_485_863
        # On the CPU whatever the device: every device draws the same.
        generator = torch.Generator().manual_seed(seed)
        return self.losses(self.network, batch, self.config, step, generator)


def neugrasp_losses(
    network: NeuGrasp, batch: Batch, config: TrainConfig, step: int, generator: torch.Generator
) -> Losses:
    """The terms of the paper's loss and of ours by name, and their weighted sum as "loss"."""
    from_meshes = bool(config.weights.distance)
    if not batch.samples:
        losses = {"grasp": head_loss(network.head, batch.truths, from_meshes, generator)}
    else:
        sharpness = config.sharpness_at(step)
        each = [joint_losses(network, one, config, sharpness, generator) for one in batch.samples]
        losses = {name: torch.stack([one[name] for one in each]).mean() for name in each[0]}
        if config.weights.rehearsal:
            losses["rehearsal"] = head_loss(network.head, batch.truths, from_meshes, generator)
    return {"loss": total(losses, config), **losses}


def total(losses: Losses, config: TrainConfig) -> Float[Tensor, ""]:
    """The weighted sum of the terms."""
    weights = config.weights
    terms = [getattr(weights, name) * value for name, value in losses.items() if getattr(weights, name)]
    return torch.stack(terms).sum()


def head_loss(
    head: nn.Module, truths: Sequence[Truth], from_meshes: bool, generator: torch.Generator
) -> Float[Tensor, ""]:
    """The grasp head alone, on true grids made imperfect the way predictions are.

    `from_meshes` takes the distance to the meshes where a scene has it, as `distance_loss` does.
    """
    grids = [
        truth.needed("distance" if from_meshes and truth.distance is not None else "tsdf") for truth in truths
    ]
    volume = head(torch.stack([perturb_tsdf(grid, generator) for grid in grids]))
    return grasp_loss(volume, [truth.labels for truth in truths])


def perturb_tsdf(tsdf: Float[Tensor, "r r r"], generator: torch.Generator) -> Float[Tensor, "r r r"]:
    """A TSDF blurred by up to a voxel, with bumps of several voxels and a little noise."""
    resolution = tsdf.shape[0]
    most = torch.tensor([1.0, 0.25, 0.05])
    blur, bumps, noise = (torch.rand(3, generator=generator) * most).to(tsdf).unbind()
    coarse = torch.randn((1, 1, 8, 8, 8), generator=generator).to(tsdf)
    smooth = F.interpolate(coarse, size=(resolution,) * 3, mode="trilinear", align_corners=False)[0, 0]
    fine = torch.randn(tsdf.shape, generator=generator).to(tsdf)
    return (_blurred(tsdf, blur) + bumps * smooth + noise * fine).clamp(-1, 1)


def _blurred(grid: Tensor, sigma: Tensor) -> Tensor:
    offsets = torch.arange(-3, 4, dtype=grid.dtype, device=grid.device)
    kernel = torch.exp(-0.5 * (offsets / sigma.clamp(min=1e-3)) ** 2)
    kernel = kernel / kernel.sum()
    x = grid.reshape(1, 1, *grid.shape)
    for axis in range(3):
        shape = [1, 1, 1, 1, 1]
        shape[axis + 2] = 7
        padding = [0, 0, 0, 0, 0, 0]
        padding[2 * (2 - axis)] = padding[2 * (2 - axis) + 1] = 3
        x = F.conv3d(F.pad(x, padding, mode="replicate"), kernel.reshape(shape))
    return x[0, 0]


def joint_losses(
    model: NeuGrasp, sample: Sample, config: TrainConfig, sharpness: float, generator: torch.Generator
) -> Losses:
    """Photos to surface to grasps, with every term that has a weight."""
    weights = config.weights
    inputs = some_views(sample.inputs, config, generator)
    scene = _encode(model, inputs)
    if not weights.needs_grid:
        return _geometry_losses(model, scene, _random_columns(model, config, generator), sample.truth)
    sdf = model.sdf_columns(scene).reshape((model.workspace.resolution,) * 3)
    reconstruction = Reconstruction(scene, sdf, scene.seen.any(0).reshape(sdf.shape))
    losses: Losses = {}
    if weights.grasp:
        losses["grasp"] = grasp_loss(model.head(reconstruction.tsdf.unsqueeze(0)), [sample.truth.labels])
    if weights.eikonal:
        losses["eikonal"] = eikonal_loss(reconstruction.sdf, reconstruction.seen, model.workspace)
    if weights.tsdf:
        losses["tsdf"] = tsdf_loss(
            reconstruction.sdf, sample.truth.needed("tsdf"), sample.truth.needed("observed")
        )
    if weights.distance or weights.occupancy:
        losses |= _geometry_losses(model, scene, None, sample.truth, sdf.flatten(0, 1))
    steepness = model.sharpness(sharpness)
    if weights.renders:
        losses["photometric"], losses["carving"] = _target_losses(
            model, reconstruction, sample.targets, steepness, config, generator
        )
    if weights.grid_carving or weights.table:
        losses["grid_carving"], losses["table"] = _carve_grid(
            model, reconstruction, (inputs, sample.targets), steepness, config.carving_rays, generator
        )
    return losses


def _geometry_losses(
    model: NeuGrasp, scene: EncodedViews, columns: Tensor | None, truth: Truth, sdf: Tensor | None = None
) -> Losses:
    """Geometry supervision at some columns of voxels, or at all."""
    sdf = model.sdf_columns(scene, columns) if sdf is None else sdf
    distance = truth.needed("distance").flatten(0, 1)
    distance = distance if columns is None else distance[columns]
    heights = scene.centres[: model.workspace.resolution, 2]
    return {
        "distance": distance_loss(sdf.float(), distance, heights, model.workspace),
        "occupancy": occupancy_loss(sdf.float(), distance, heights, model.workspace),
    }


def _random_columns(model: NeuGrasp, config: TrainConfig, generator: torch.Generator) -> Tensor | None:
    num = model.workspace.resolution**2
    if not 0 < config.columns < num:
        return None
    device = next(model.parameters()).device
    return torch.randperm(num, generator=generator)[: config.columns].to(device)


def _encode(model: NeuGrasp, inputs: Photos) -> EncodedViews:
    views = inputs.views
    if not model.config.use_backgrounds:
        return model.encode_scene(model.encode(views.images), None, views)
    maps = model.encode(torch.cat([views.images, views.backgrounds]))
    scene, background = maps.split(len(views.images))
    return model.encode_scene(scene, background, views)


def some_views(photos: Photos, config: TrainConfig, generator: torch.Generator) -> Photos:
    """All the views in random order, or sometimes fewer of them."""
    count = len(photos.changes)
    order = torch.randperm(count, generator=generator).tolist()
    least = config.min_views
    if count > least and float(torch.rand((), generator=generator)) < config.view_dropout:
        order = order[: int(torch.randint(least, count, (), generator=generator))]
    return drop_views(photos, order)


def _target_losses(
    model: NeuGrasp,
    reconstruction: Reconstruction[EncodedViews],
    targets: Photos,
    sharpness: Tensor,
    config: TrainConfig,
    generator: torch.Generator,
) -> tuple[Tensor, Tensor]:
    """Photometric and carving loss of rays of one target view."""
    view = int(torch.randint(len(targets.changes), (), generator=generator))
    rays, row, column = choose_rays(model, targets, view, config.rays, generator)
    coarse, fine = model.render(reconstruction.scene, rays, sharpness, generator)
    colour = targets.views.images[view, :, row, column].T
    behind = targets.views.backgrounds[view, :, row, column].T
    photometric = photometric_loss(coarse, colour, behind) + photometric_loss(fine, colour, behind)
    labels = targets.changes[view, row, column]
    carved = [
        carving_loss(one.weights, one.midpoints, rays, labels, model.workspace) for one in (coarse, fine)
    ]
    return photometric, torch.stack(carved).mean()


def _carve_grid(
    model: NeuGrasp,
    reconstruction: Reconstruction[EncodedViews],
    photos: tuple[Photos, ...],
    sharpness: Tensor,
    num: int,
    generator: torch.Generator,
) -> tuple[Tensor, Tensor]:
    """Carving of the grid itself by `num` rays of every photo, inputs too; and the table's place in it.

    Opacity needs no colours, so nothing can be copied from an input, and reading the grid along a ray costs
    next to nothing: this teaches the very values that the grasp head and the surface are made from.
    """
    carved, table = [], []
    for group in photos:
        for view in range(len(group.changes)):
            rays, row, column = choose_rays(model, group, view, num, generator)
            weights, midpoints = model.weights_on_grid(reconstruction, rays, sharpness, generator)
            labels = group.changes[view, row, column]
            carved.append(carving_loss(weights, midpoints, rays, labels, model.workspace))
            table.append(table_loss(reconstruction.sdf, rays, labels, model.workspace))
    return torch.stack(carved).mean(), torch.stack(table).mean()


def choose_rays(
    model: NeuGrasp, photos: Photos, view: int, num: int, generator: torch.Generator
) -> tuple[Rays, Int[Tensor, " rays"], Int[Tensor, " rays"]]:
    """Up to `num` rays of one view through the workspace, with their rows and columns.

    Half of them through pixels of objects and a band around them, half through any.
    """
    changes = photos.changes[view]
    height, width = changes.shape
    candidates = torch.randint(height * width, (4 * num,), generator=generator).to(changes.device)
    row, column = candidates // width, candidates % width
    pixels = torch.stack([column, row], dim=1).float()
    origins, directions = photos.views.cameras.rays(view, pixels)
    rays = cut_to_workspace(origins, directions, model.workspace)
    left, top, right, bottom = photos.views.cameras.bounds[view]
    measured = (column > left) & (column < right) & (row > top) & (row < bottom)
    usable = (rays.far > rays.near + 1e-3) & measured
    near = _near_change(changes)[row // CELL, column // CELL]
    changed = torch.nonzero(usable & near).squeeze(1)[: num // 2]
    rest = torch.nonzero(usable).squeeze(1)
    chosen = torch.cat([changed, rest[: num - len(changed)]])
    return rays.select(chosen), row[chosen], column[chosen]


def _near_change(changes: Tensor) -> Tensor:
    """Cells of the photo (bool) that hold something else than table, or touch a cell that does."""
    changed = (changes != TABLE).float()[None, None]
    cells = F.max_pool2d(changed, CELL, ceil_mode=True)
    return F.max_pool2d(cells, 3, stride=1, padding=1)[0, 0] > 0
