"""The head asked in eight poses: its answer moves with the scene, and errors of single poses cancel."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from neugrasp.detection.decode import Prediction
from neugrasp.detection.test_time_augmentation import predict_grasps
from neugrasp.geometry.symmetry import SYMMETRIES
from neugrasp.model.config import ModelConfig
from neugrasp.model.grasp_head import GraspHead, GraspVolume

ONE_POSE = SYMMETRIES[:1]


@pytest.fixture(scope="module")
def head() -> GraspHead:
    torch.manual_seed(3)
    return GraspHead(ModelConfig(head_channels=(4, 8, 8)))


def rotations(asked: Prediction) -> np.ndarray:
    """At all voxels: (4, r, r, r)."""
    shape = asked.tsdf.shape
    return asked.rotations(np.argwhere(np.ones(shape, dtype=bool))).T.reshape(4, *shape)


@pytest.fixture
def tsdf(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-1, 1, (16, 16, 16)).astype(np.float32)


def angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Between grasps (4, r, r, r), which are the same after half a turn about the approach."""
    first, second = (Rotation.from_quat(each.reshape(4, -1).T) for each in (a, b))
    half = Rotation.from_euler("z", np.pi)
    return np.minimum((first.inv() * second).magnitude(), (first.inv() * second * half).magnitude())


def test_one_pose_is_the_head_itself(head: GraspHead, tsdf: np.ndarray):
    with torch.no_grad():
        volume = head(torch.from_numpy(tsdf)[None])
    asked = predict_grasps(head, tsdf, symmetries=ONE_POSE)
    np.testing.assert_allclose(asked.quality, volume.quality[0].numpy(), atol=1e-6)
    np.testing.assert_allclose(asked.width, volume.width[0].numpy(), atol=1e-6)
    assert angles(rotations(asked), volume.rotation[0].numpy()).max() < 1e-3


@pytest.mark.parametrize("symmetry", SYMMETRIES[1:], ids=str)
def test_quality_and_width_move_with_the_scene(symmetry, head: GraspHead, tsdf: np.ndarray):
    here, moved = (predict_grasps(head, grid) for grid in (tsdf, symmetry.of_grid(tsdf)))
    np.testing.assert_allclose(moved.quality, symmetry.of_grid(here.quality), atol=1e-5)
    np.testing.assert_allclose(moved.width, symmetry.of_grid(here.width), atol=1e-5)
    alone = predict_grasps(head, symmetry.of_grid(tsdf), symmetries=ONE_POSE)
    assert np.abs(alone.quality - symmetry.of_grid(here.quality)).max() > 1e-3


def test_a_head_that_moves_with_the_scene_is_left_as_it_is(tsdf: np.ndarray):
    """What a perfect head says in all poses has to survive the mean, as itself or as its half turn."""
    truth = Rotation.random(16**3, random_state=4).as_quat().reshape(16, 16, 16, 4)
    half = Rotation.from_euler("z", np.pi)

    def perfect(grids: torch.Tensor) -> GraspVolume:
        moved = [symmetry.of_rotations(symmetry.of_grid(truth)) for symmetry in SYMMETRIES]
        flat = Rotation.from_quat(moved[5].reshape(-1, 4)) * half
        moved[5] = flat.as_quat().reshape(truth.shape)
        rotation = torch.from_numpy(np.moveaxis(np.stack(moved), -1, 1)).float()
        return GraspVolume(grids, rotation, grids, grids)

    asked = predict_grasps(perfect, tsdf)
    assert angles(rotations(asked), np.moveaxis(truth, -1, 0)).max() < 2e-3
    np.testing.assert_allclose(asked.width, tsdf, atol=1e-6)


def test_a_head_that_is_sure_raises_no_warning(tsdf: np.ndarray):
    def sure(grids: torch.Tensor) -> GraspVolume:
        rotation = torch.zeros((len(grids), 4, 16, 16, 16))
        return GraspVolume(grids, rotation, grids, 1000 * grids.sign())

    assert set(np.unique(predict_grasps(sure, tsdf).quality)) <= {0, 1}


def test_errors_of_single_poses_cancel(tsdf: np.ndarray, rng: np.random.Generator):
    axes = np.array([0.1, 0.1, 0.1])

    def shaky(grids: torch.Tensor) -> GraspVolume:
        errors = Rotation.from_rotvec(rng.normal(0, axes, (len(grids) * 16**3, 3)))
        turns = [Rotation.from_quat(s.of_rotations([0.0, 0.0, 0.0, 1.0])) for s in SYMMETRIES[: len(grids)]]
        exact = Rotation.concatenate([Rotation.from_quat(np.tile(t.as_quat(), (16**3, 1))) for t in turns])
        rotation = torch.from_numpy((exact * errors).as_quat()).float().reshape(-1, 16, 16, 16, 4)
        return GraspVolume(grids, rotation.movedim(-1, 1), grids, grids)

    straight = np.zeros((4, 16, 16, 16))
    straight[3] = 1
    alone = angles(rotations(predict_grasps(shaky, tsdf, symmetries=ONE_POSE)), straight).mean()
    together = angles(rotations(predict_grasps(shaky, tsdf)), straight).mean()
    assert together < 0.5 * alone
