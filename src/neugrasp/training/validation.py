"""How good the network is on records it does not train on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor, nn

from neugrasp.geometry.workspace import Workspace
from neugrasp.metrics import CONSTANTS, area_under_roc, l1_by_mask, occupancy_iou, psnr, ssim, volume_ratio
from neugrasp.model.grasp_head import GraspVolume
from neugrasp.model.inputs import ViewTensors
from neugrasp.model.network import Reconstruction
from neugrasp.model.rendering import Rays, Rendered, cut_to_workspace
from neugrasp.training.losses import grasp_loss, rotation_distance
from neugrasp.training.samples import LabelTensors, Photos, Sample, Truth

RENDER_STRIDE = 4
"""Every how many pixels the held-out view is rendered: enough for PSNR, and 16 times faster."""


@dataclass
class Scores:
    """Means over the scenes validated so far, by name."""

    values: dict[str, list[float]] = field(default_factory=dict)

    def add(self, **values: float) -> None:
        """Adds one scene's values."""
        for name, value in values.items():
            self.values.setdefault(name, []).append(value)

    def means(self) -> dict[str, float]:
        """The mean of each, leaving out scenes where it does not exist; NaN where it exists in none."""
        kept = {name: [v for v in values if not np.isnan(v)] for name, values in self.values.items()}
        return {name: float(np.mean(values)) if values else float("nan") for name, values in kept.items()}


class SurfaceNetwork(Protocol):
    """A network that makes a surface and grasps of photos, and can be rendered."""

    workspace: Workspace
    head: Any
    """The grasp head, a module."""
    training: bool

    def __call__(self, views: ViewTensors) -> tuple[Reconstruction[Any], GraspVolume]:
        """Surface and grasps."""
        ...

    def render(self, scene: Any, rays: Rays, sharpness: Float[Tensor, ""]) -> tuple[Rendered, Rendered]:
        """Coarse and fine renderings of rays."""
        ...

    def sharpness(self, scheduled: float, /) -> Float[Tensor, ""]:
        """That of NeuS, in 1 / metre."""
        ...

    def parameters(self) -> Iterator[nn.Parameter]:
        """As PyTorch's."""
        ...

    def train(self, mode: bool = True) -> Any:
        """As PyTorch's."""
        ...


@torch.no_grad()
def reconstruct(model: SurfaceNetwork, sample: Sample) -> tuple[Reconstruction[Any], GraspVolume]:
    """Surface and grasps of a sample's input views."""
    device = next(model.parameters()).device
    return model(sample.inputs.views.to(device))


@torch.no_grad()
def render_view(
    model: SurfaceNetwork, reconstruction: Reconstruction[Any], photos: Photos, view: int, sharpness: float
) -> tuple[Float32[np.ndarray, "height width 3"], Float32[np.ndarray, "height width 3"]]:
    """The rendered view and the photo at every fourth pixel; rays that miss show the background."""
    size = photos.views.images.shape[-1]
    axis = torch.arange(RENDER_STRIDE // 2, size, RENDER_STRIDE)
    row, column = torch.meshgrid(axis, axis, indexing="ij")
    device = reconstruction.sdf.device
    photos = photos.to(device)
    pixels = torch.stack([column.flatten(), row.flatten()], dim=1).float().to(device)
    rays = cut_to_workspace(*photos.views.cameras.rays(view, pixels), model.workspace)
    image = photos.views.backgrounds[view][:, row, column].flatten(1).T.clone()
    hits = torch.nonzero(rays.far > rays.near).squeeze(1)
    for chunk in hits.split(1024):
        _, fine = model.render(reconstruction.scene, rays.select(chunk), model.sharpness(sharpness))
        image[chunk] = fine.colour + (1 - fine.opacity).clamp(min=0).unsqueeze(1) * image[chunk]
    count = len(axis)
    truth = photos.views.images[view][:, row, column].permute(1, 2, 0)
    return image.reshape(count, count, 3).clamp(0, 1).cpu().numpy(), truth.cpu().numpy()


def grasp_scores(volume: GraspVolume, labels: LabelTensors) -> dict[str, float]:
    """AUC of the quality at the labelled voxels, and the mean rotation error of the successes in degrees."""
    labels = labels.to(volume.quality.device)
    x, y, z = labels.index.unbind(1)
    quality = volume.quality[0, x, y, z].cpu().numpy()
    success = labels.success.cpu().numpy()
    similarity = 1 - rotation_distance(volume.rotation[0, :, x, y, z].T, labels.quaternions)
    degrees = 2 * np.rad2deg(np.arccos(similarity.clamp(0, 1).cpu().numpy()))
    error = float(degrees[success].mean()) if success.any() else float("nan")
    return {"grasp_auc": area_under_roc(quality, success), "rotation_error_deg": error}


@torch.no_grad()
def validate_head(model: SurfaceNetwork, truths: Sequence[Truth]) -> dict[str, float]:
    """Means over scenes: AUC and rotation error of the grasp head on the true grids."""
    scores = Scores()
    device = next(model.parameters()).device
    for truth in truths:
        tsdf = truth.needed("tsdf")
        found = grasp_scores(model.head(tsdf.unsqueeze(0).to(device)), truth.labels)
        scores.add(**{f"true_grid_{name}": value for name, value in found.items()})
    return scores.means()


def validate(
    model: SurfaceNetwork, samples: Sequence[Sample], sharpness: float, render: bool = True
) -> dict[str, float]:
    """Means over samples: the grasp loss, AUC, rotation error, PSNR, SSIM; where the surface is known, L1
    under five masks beside the constants', and IoU.

    `iou` is against the fused TSDF, `iou_meshes` and `volume` (predicted over true) against the distance to
    the meshes where the samples have it.
    """
    was_training = model.training
    model.train(False)
    scores = Scores()
    table = int(model.workspace.table_height / model.workspace.voxel_size) + 1
    for sample in samples:
        reconstruction, volume = reconstruct(model, sample)
        tsdf = reconstruction.tsdf.cpu().numpy()
        labels = sample.truth.labels.to(volume.quality.device)
        scores.add(grasp_loss=float(grasp_loss(volume, [labels])), **grasp_scores(volume, labels))
        if sample.truth.tsdf is not None:
            truth = sample.truth.tsdf.numpy()
            scores.add(**{f"l1_{a}": value for a, value in l1_by_mask(tsdf, truth).items()})
            for constant in CONSTANTS:
                scores.add(**{f"l1_0.3_constant_{constant:+.0f}": l1_by_mask(constant, truth)["0.3"]})
            scores.add(iou=occupancy_iou(tsdf, truth, table))
        if sample.truth.distance is not None:
            meshes = sample.truth.distance.numpy()
            scores.add(
                iou_meshes=occupancy_iou(tsdf, meshes, table), volume=volume_ratio(tsdf, meshes, table)
            )
        if render:
            image, photo = render_view(model, reconstruction, sample.targets, 0, sharpness)
            scores.add(psnr=psnr(image, photo), ssim=ssim(image, photo))
    model.train(was_training)
    return scores.means()
