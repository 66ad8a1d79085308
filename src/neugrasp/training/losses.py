"""One function per term of the loss."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from neugrasp.change_mask import OBJECT, TABLE
from neugrasp.geometry.sampling import sample_volume
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.grasp_head import GraspVolume, half_turned
from neugrasp.model.rendering import Rays, Rendered
from neugrasp.training.samples import LabelTensors

Scalar = Float[Tensor, ""]

CARVING_CLEARANCE = 0.006
"""Metres above the table from which on opacity counts as an object's."""


def photometric_loss(
    rendered: Rendered, colour: Float[Tensor, "rays 3"], behind: Float[Tensor, "rays 3"]
) -> Scalar:
    """Squared error summed over RGB, mean over rays; colour of the photo.

    What gets through the whole workspace shows the empty scene `behind` it.
    """
    seen = rendered.colour + (1 - rendered.opacity).clamp(min=0).unsqueeze(-1) * behind
    return (seen - colour).square().sum(-1).mean()


def carving_loss(
    weights: Float[Tensor, "rays intervals"],
    midpoints: Float[Tensor, "rays intervals"],
    rays: Rays,
    labels: Int[Tensor, " rays"],
    workspace: Workspace,
) -> Scalar:
    """Cross-entropy of the opacity above the table, half for objects' pixels, half for the table's.

    Weights and midpoints (metres) are those of intervals along the rays; labels are of `change_labels`.
    """
    heights = rays.origins[:, 2:] + midpoints * rays.directions[:, 2:]
    above = (heights > workspace.table_height + CARVING_CLEARANCE).to(weights)
    opacity = (weights * above).sum(1).clamp(1e-4, 1 - 1e-4)
    terms = []
    if (matter := labels == OBJECT).any():
        terms.append(-torch.log(opacity[matter]).mean())
    if (free := labels == TABLE).any():
        terms.append(-torch.log1p(-opacity[free]).mean())
    return 0.5 * torch.stack(terms).sum() if terms else opacity.sum() * 0


def table_loss(
    sdf: Float[Tensor, "r r r"], rays: Rays, labels: Int[Tensor, " rays"], workspace: Workspace
) -> Scalar:
    """Mean |sdf| where rays through pixels that show the table meet its plane, inside the cube.

    sdf in truncation units; labels of `change_labels`. Free space says where nothing is, and a
    table that has sunk is free space, too: only this keeps it in place.
    """
    distances = (workspace.table_height - rays.origins[:, 2]) / rays.directions[:, 2]
    met = (labels == TABLE) & (distances > rays.near) & (distances < rays.far)
    if not met.any():
        return sdf.sum() * 0
    points = rays.select(met).points(distances[met].unsqueeze(1)).squeeze(1)
    return sample_volume(sdf.unsqueeze(0), workspace.to_unit(points)).abs().mean()


def eikonal_loss(sdf: Float[Tensor, "x y z"], seen: Bool[Tensor, "x y z"], workspace: Workspace) -> Scalar:
    """Mean of (|gradient| - 1)^2 by differences on the grid, where the distance is not truncated.

    sdf in truncation units, so that lengths are metres over metres. The
    square of a derivative is the mean of those to either neighbour: central differences would not see a
    pattern that alternates from voxel to voxel, and the network would find it.
    """
    slope = sdf * (workspace.truncation / workspace.voxel_size)
    core = (slice(1, -1),) * 3
    squares = [
        ((slope.roll(shift, axis) - slope)[core]).square() / 2 for axis in range(3) for shift in (-1, 1)
    ]
    norm = (torch.stack(squares).sum(0) + 1e-8).sqrt()
    counts = (sdf.detach().abs() < 1)[core] & seen[core]
    return ((norm - 1).square() * counts).sum() / counts.sum().clamp(min=1)


def tsdf_loss(
    sdf: Float[Tensor, "x y z"], truth: Float[Tensor, "x y z"], observed: Bool[Tensor, "x y z"]
) -> Scalar:
    """Smooth L1 of signed distances to the true TSDF where it was observed, mean over the observed voxels.

    Distances are not truncated but where the truth is 1: else a voxel once far on the wrong side of the
    surface would have no gradient and stay there.
    """
    error = F.smooth_l1_loss(torch.where(truth >= 1, sdf.clamp(max=1), sdf), truth, reduction="none")
    return (error * observed).sum() / observed.sum().clamp(min=1)


BAND, BAND_WEIGHT, INSIDE_WEIGHT = 0.99, 5.0, 1.7
"""Voxels whose true distance is less than this count as near the surface, and so many times as much; those
inside as much again. A plain mean lets a surface that is uncertain vanish: most voxels are far outside."""
STEEPNESS = 4.0
"""The logit of being inside is -4 sdf: 0.88 half a truncation inside."""


def distance_loss(
    sdf: Float[Tensor, "columns r"],
    truth: Float[Tensor, "columns r"],
    heights: Float[Tensor, " r"],
    workspace: Workspace,
) -> Scalar:
    """Weighted smooth L1 (beta 0.1) of signed distances to those of the meshes, above the table.

    sdf and truth in truncation units; heights of the voxels, metres. Beyond the truncation there is
    no error on the right side of it.
    """
    beyond = ((truth >= 1) & (sdf > 1)) | ((truth <= -1) & (sdf < -1))
    error = F.smooth_l1_loss(torch.where(beyond, truth, sdf), truth, reduction="none", beta=0.1)
    return _near_surface_mean(error, truth, heights, workspace)


def occupancy_loss(
    sdf: Float[Tensor, "columns r"],
    truth: Float[Tensor, "columns r"],
    heights: Float[Tensor, " r"],
    workspace: Workspace,
) -> Scalar:
    """Weighted cross-entropy of being inside the meshes, above the table; units as in `distance_loss`.

    Unlike a regression it does not average an uncertain surface away.
    """
    logits = -STEEPNESS * sdf.clamp(-2, 2)
    inside = (truth < 0).to(logits)
    error = F.binary_cross_entropy_with_logits(logits, inside, reduction="none")
    return _near_surface_mean(error, truth, heights, workspace)


def _near_surface_mean(error: Tensor, truth: Tensor, heights: Tensor, workspace: Workspace) -> Tensor:
    near = 1 + (BAND_WEIGHT - 1) * (truth.abs() < BAND)
    weights = near * (1 + (INSIDE_WEIGHT - 1) * (truth < 0)) * (heights > workspace.table_height)
    return (weights * error).sum() / weights.sum().clamp(min=1)


def grasp_loss(volume: GraspVolume, labels: list[LabelTensors]) -> Scalar:
    """Cross-entropy of the quality, plus rotation and 0.01 width^2 where a grasp succeeded (VGN).

    One entry of `labels` for each grid of the volume. Successes and failures count half each, whatever
    their number.
    """
    return torch.stack([_grasp_loss_of(volume, index, one) for index, one in enumerate(labels)]).mean()


def _grasp_loss_of(volume: GraspVolume, grid: int, labels: LabelTensors) -> Tensor:
    x, y, z = labels.index.unbind(1)
    logits = volume.logits[grid, x, y, z]
    success = labels.success
    entropy = F.binary_cross_entropy_with_logits(logits, success.to(logits), reduction="none")
    positives, negatives = success.sum().clamp(min=1), (~success).sum().clamp(min=1)
    balanced = 0.5 * ((entropy * success).sum() / positives + (entropy * ~success).sum() / negatives)
    rotation = rotation_distance(volume.rotation[grid, :, x, y, z].T, labels.quaternions)
    width = (volume.width[grid, x, y, z] - labels.widths).square()
    return balanced + ((rotation + 0.01 * width) * success).sum() / positives


def rotation_distance(
    predicted: Float[Tensor, "grasps 4"], truth: Float[Tensor, "grasps 4"]
) -> Float[Tensor, " grasps"]:
    """1 - |q . q'| of unit quaternions xyzw; a half turn about the approach costs nothing."""
    same = half_turned(truth)
    similarity = torch.maximum((predicted * truth).sum(1).abs(), (predicted * same).sum(1).abs())
    return 1 - similarity
