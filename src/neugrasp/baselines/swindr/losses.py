"""The losses of SwinDR on its restored and its initial depth (Dai et al., ECCV 2022), and its judges."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image as PilImage
from torch import Tensor

from neugrasp.baselines.swindr.network import Restored, SwinDR
from neugrasp.baselines.swindr.pictures import restoration_picture
from neugrasp.geometry.sampling import CameraTensors
from neugrasp.training.config import TrainConfig
from neugrasp.training.dataset import Batch
from neugrasp.training.module import Losses
from neugrasp.training.networks import HeldOut, NetworkSpec
from neugrasp.training.samples import Photos

INITIAL = 0.4
"""What the initial depth counts beside the restored one."""
BACKGROUND = 0.4
"""What the mean over the background's pixels counts beside that over the objects'."""
NORMALS = 0.1
SLOPES = 0.6
CLOSE = 0.005
"""Metres within which a depth is counted as right."""


def swindr_losses(
    network: SwinDR, batch: Batch, config: TrainConfig, step: int, generator: torch.Generator
) -> Losses:
    """The terms by name, and their weighted sum as "loss"."""
    del config, step, generator
    each = [_losses_of(network, sample.inputs) for sample in batch.samples]
    losses = {name: torch.stack([one[name] for one in each]).mean() for name in each[0]}
    return {"loss": losses["restored"] + INITIAL * losses["initial"], **losses}


def _losses_of(network: SwinDR, photos: Photos) -> Losses:
    truth, measured, objects = sensed(photos)
    found = network(photos.views.images, measured)
    cameras, known = photos.views.cameras, known_pixels(truth, photos.views.cameras)
    return {
        "restored": depth_loss(found.depth, truth, known, objects, cameras),
        "initial": depth_loss(found.initial, truth, known, objects, cameras),
    }


def sensed(photos: Photos) -> tuple[Tensor, Tensor, Tensor]:
    """True depth, measured depth and where objects are, (n, s, s) each; the data set has them."""
    if photos.depths is None or photos.sensor is None:
        raise ValueError("the photos have no depth, true and measured")
    return photos.depths, photos.sensor.measured, photos.sensor.objects


def known_pixels(truth: Tensor, cameras: CameraTensors) -> Tensor:
    """(n, s, s) bool: pixels of the photo, and not of what pads it, whose neighbours have a depth, too."""
    size = truth.shape[-1]
    place = torch.arange(size, device=truth.device)
    left, top, right, bottom = (edge[:, None] for edge in cameras.bounds.unbind(1))
    across, down = (place > left) & (place < right), (place > top) & (place < bottom)
    inside = across[:, None, :] & down[:, :, None] & (truth > 0)
    return F.max_pool2d((~inside).float()[:, None], 3, stride=1, padding=1)[:, 0] == 0


def depth_loss(
    depth: Tensor, truth: Tensor, known: Tensor, objects: Tensor, cameras: CameraTensors
) -> Tensor:
    """Errors of depth, normals and slopes over objects and, for less, over the background; (n, s, s)."""
    error = (depth - truth).abs()
    error = error + NORMALS * (_normals(depth, cameras) - _normals(truth, cameras)).abs().mean(1)
    error = error + SLOPES * (_slopes(depth) - _slopes(truth)).abs().sum(1)
    parts = ((known & objects, 1.0), (known & ~objects, BACKGROUND))
    return torch.stack([
        weight * (error * mask).sum() / mask.sum().clamp(min=1) for mask, weight in parts
    ]).sum()  # fmt: skip


def _slopes(depth: Tensor) -> Tensor:
    """Sobel's two (n, 2, h, w), in metres; edges are repeated."""
    kernel = depth.new_tensor([[-1.0, 0, 1], [-2, 0, 2], [-1, 0, 1]])
    padded = F.pad(depth[:, None], (1, 1, 1, 1), mode="replicate")
    return F.conv2d(padded, torch.stack([kernel, kernel.T])[:, None])


def _normals(depth: Tensor, cameras: CameraTensors) -> Tensor:
    """Unit normals (n, 3, h, w) of the surface that the depth shows, camera frame."""
    size = torch.arange(depth.shape[-1], device=depth.device)
    focal, middle = (cameras.intrinsics[:, i, j] for i, j in (([0, 1], [0, 1]), ([0, 1], [2, 2])))
    x = (size - middle[:, :1]) / focal[:, :1]
    y = (size - middle[:, 1:]) / focal[:, 1:]
    points = torch.stack([depth * x[:, None, :], depth * y[:, :, None], depth], 1)
    padded = F.pad(points, (1, 1, 1, 1), mode="replicate")
    across = padded[:, :, 1:-1, 2:] - padded[:, :, 1:-1, :-2]
    down = padded[:, :, 2:, 1:-1] - padded[:, :, :-2, 1:-1]
    return F.normalize(torch.linalg.cross(across, down, dim=1), dim=1, eps=1e-12)


@torch.no_grad()
def judge(
    network: SwinDR, held_out: HeldOut, config: TrainConfig, step: int, folder: Path
) -> dict[str, float]:
    """Errors before and after in millimetres, shares of pixels within 5 mm, over objects and background."""
    device = next(network.parameters()).device
    was_training = network.training
    network.eval()
    scores: dict[str, list[float]] = {}
    for sample in held_out.samples:
        photos = sample.inputs.to(device)
        for name, score in _scores(photos, network(photos.views.images, sensed(photos)[1])):
            scores.setdefault(name, []).append(score)
    if held_out.samples:
        first = held_out.samples[0].inputs.to(device)
        _, measured, _ = sensed(first)
        picture = restoration_picture(first, network(first.views.images, measured))
        PilImage.fromarray(picture).save(folder / f"progress_{step:06d}.png")
    network.train(was_training)
    return {name: float(np.nanmean(values)) for name, values in scores.items()}


def _scores(photos: Photos, found: Restored) -> Iterator[tuple[str, float]]:
    truth, measured, objects = sensed(photos)
    known = known_pixels(truth, photos.views.cameras)
    for name, where in (("objects", known & objects), ("background", known & ~objects)):
        for what, depth in (("measured", measured), ("restored", found.depth)):
            error = (depth - truth)[where & (depth > 0)].abs()
            yield f"{what}_{name}_mm", 1000 * float(error.mean())
            yield f"{what}_{name}_close", float((error < CLOSE).sum() / where.sum().clamp(min=1))


NETWORK = NetworkSpec(SwinDR, swindr_losses, judge, compares=False, measures=True)
