"""Each term of the loss where its value is known."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch.testing import assert_close

from neugrasp.change_mask import OBJECT, TABLE, UNSURE
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.grasp_head import GraspVolume
from neugrasp.model.rendering import Rays
from neugrasp.training.losses import (
    carving_loss,
    eikonal_loss,
    grasp_loss,
    rotation_distance,
    table_loss,
    tsdf_loss,
)
from neugrasp.training.module import perturb_tsdf
from neugrasp.training.samples import LabelTensors


def test_a_true_distance_has_no_eikonal_loss_and_a_scaled_one_has():
    workspace = Workspace()
    centres = torch.from_numpy(workspace.voxel_centres()).float()
    sphere = ((centres - torch.tensor([0.15, 0.15, 0.1])).norm(dim=-1) - 0.05) / workspace.truncation
    seen = torch.ones(40, 40, 40, dtype=torch.bool)
    assert eikonal_loss(sphere, seen, workspace) < 0.01
    assert_close(eikonal_loss(2 * sphere, seen, workspace), torch.tensor(1.0), atol=0.05, rtol=0)


def test_a_pattern_from_voxel_to_voxel_is_not_free():
    """Central differences would call this checkerboard constant."""
    workspace = Workspace()
    index = torch.arange(40)
    board = (index[:, None, None] + index[None, :, None] + index[None, None, :]) % 2
    plane = torch.from_numpy(workspace.voxel_centres()[..., 2] - 0.15).float() / workspace.truncation
    seen = torch.ones(40, 40, 40, dtype=torch.bool)
    clean = eikonal_loss(plane, seen, workspace)
    assert clean < 1e-4
    assert eikonal_loss(plane + 0.3 * (board - 0.5), seen, workspace) > 0.5


def test_a_half_turn_about_the_approach_is_the_same_rotation():
    truth = Rotation.random(20, random_state=1)
    turned = truth * Rotation.from_euler("z", np.pi)
    as_tensor = lambda rotation: torch.from_numpy(rotation.as_quat()).float()  # noqa: E731
    assert_close(rotation_distance(as_tensor(turned), as_tensor(truth)), torch.zeros(20), atol=1e-6, rtol=0)
    assert_close(rotation_distance(-as_tensor(truth), as_tensor(truth)), torch.zeros(20), atol=1e-6, rtol=0)
    quarter = truth * Rotation.from_euler("x", np.pi / 2)
    assert (rotation_distance(as_tensor(quarter), as_tensor(truth)) > 0.2).all()


@pytest.mark.parametrize(("label", "good"), [(OBJECT, 0.9), (TABLE, 0.1)])
def test_carving_wants_opacity_before_changed_pixels_only(label, good):
    workspace = Workspace()
    origins = torch.tensor([[0.15, 0.15, 0.6]])
    rays = Rays(origins, torch.tensor([[0.0, 0, -1]]), torch.tensor([0.3]), torch.tensor([0.57]))
    midpoints = torch.tensor([[0.4, 0.56]])  # 15 cm above the table, and 1 cm below it
    labels = torch.tensor([label])
    losses = [
        carving_loss(torch.tensor([[share, 1 - share]]), midpoints, rays, labels, workspace)
        for share in (good, 1 - good)
    ]
    assert losses[0] < losses[1]
    assert_close(losses[0], torch.tensor(-0.5 * np.log(0.9)).float())
    unsure = torch.tensor([UNSURE])
    assert carving_loss(torch.tensor([[good, 0.0]]), midpoints, rays, unsure, workspace) == 0


def test_unobserved_voxels_do_not_count_in_the_tsdf_loss():
    predicted, truth = torch.full((2, 2, 2), 0.5), torch.zeros(2, 2, 2)
    observed = torch.zeros(2, 2, 2, dtype=torch.bool)
    observed[0] = True
    assert_close(tsdf_loss(predicted, truth, observed), torch.tensor(0.125))
    assert tsdf_loss(predicted, truth, torch.zeros_like(observed)) == 0


def test_the_tsdf_loss_pulls_back_what_is_far_on_the_wrong_side():
    sdf = torch.tensor([[[3.0, 3.0, -2.0]]], requires_grad=True)
    truth = torch.tensor([[[1.0, -0.5, 1.0]]])
    tsdf_loss(sdf, truth, torch.ones_like(truth, dtype=torch.bool)).backward()
    assert sdf.grad is not None
    free, inside, outside = sdf.grad.flatten().tolist()
    assert free == 0
    assert inside > 0
    assert outside < 0


def test_the_grasp_loss_reads_its_own_voxels():
    logits = torch.zeros(1, 4, 4, 4)
    logits[0, 1, 2, 3] = 20.0
    logits[0, 3, 0, 1] = -20.0
    rotation = torch.zeros(1, 4, 4, 4, 4)
    rotation[:, 3] = 1.0
    volume = GraspVolume(torch.sigmoid(logits), rotation, torch.full((1, 4, 4, 4), 5.0), logits)
    labels = LabelTensors(
        torch.tensor([[1, 2, 3], [3, 0, 1]]),
        torch.tensor([[0.0, 0, 0, 1], [0.0, 0, 0, 1]]),
        torch.tensor([5.0, 0.0]),
        torch.tensor([True, False]),
    )
    assert grasp_loss(volume, [labels]) < 1e-6
    wrong = LabelTensors(labels.index, labels.quaternions, torch.tensor([7.0, 0.0]), labels.success)
    assert_close(grasp_loss(volume, [wrong]), torch.tensor(0.04), atol=1e-5, rtol=0)


def test_imperfect_grids_stay_in_range_and_near_the_truth():
    workspace = Workspace()
    heights = torch.from_numpy(workspace.voxel_centres()[..., 2]).float()
    truth = ((heights - workspace.table_height) / workspace.truncation).clamp(-1, 1)
    worse = perturb_tsdf(truth, torch.Generator().manual_seed(0))
    assert worse.abs().max() <= 1
    assert 0 < (worse - truth).abs().mean() < 0.3


def test_the_table_is_held_where_it_is_seen():
    """A plane at the right height costs nothing, one sunk by 6 mm costs 0.2; an object says nothing of it."""
    workspace = Workspace()
    heights = torch.from_numpy(workspace.voxel_centres()[..., 2]).float() - workspace.table_height
    origins = torch.tensor([[0.15, 0.15, 0.6]]).expand(4, 3)
    directions = torch.nn.functional.normalize(
        torch.tensor([[0.0, 0, -1], [0.1, 0, -1], [0, -0.2, -1], [0.1, 0.1, -1]]), dim=1
    )
    rays = Rays(origins, directions, torch.full((4,), 0.3), torch.full((4,), 0.7))
    labels = torch.tensor([TABLE, TABLE, TABLE, OBJECT])
    held = table_loss(heights / workspace.truncation, rays, labels, workspace)
    assert_close(held, torch.tensor(0.0), atol=1e-5, rtol=0)
    sunk = table_loss((heights + 0.006) / workspace.truncation, rays, labels, workspace)
    assert_close(sunk, torch.tensor(0.2), atol=1e-4, rtol=0)
    assert table_loss(heights + 1, rays, torch.full((4,), OBJECT), workspace) == 0
