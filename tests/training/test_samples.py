"""The eight symmetries of the workspace: everything in a sample moves together."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy import ndimage
from scipy.spatial.transform import Rotation

from neugrasp.geometry.workspace import Workspace
from neugrasp.training.change import OBJECT, TABLE
from neugrasp.training.samples import Symmetry, drop_views, prepare_record, sample_of

ALL = [Symmetry(turns, mirrored) for turns in range(4) for mirrored in (False, True)]


@pytest.mark.parametrize("symmetry", ALL, ids=str)
def test_a_point_projects_to_the_same_picture_element(symmetry, make_record, rng):
    workspace = Workspace()
    record = make_record(x=0.12, y=0.19)
    points = rng.uniform(0.05, 0.25, (50, 3))
    matrix = symmetry.matrix(workspace)
    moved_points = points @ matrix[:3, :3].T + matrix[:3, 3]
    columns = np.tile(np.arange(64.0), (64, 1))
    for camera in record.cameras:
        moved = symmetry.of_camera(camera, workspace)
        assert np.isclose(np.linalg.det(moved.world_from_camera[:3, :3]), 1)
        before, depth = camera.project(points)
        after, same_depth = moved.project(moved_points)
        np.testing.assert_allclose(depth, same_depth)
        np.testing.assert_allclose(before[:, 1], after[:, 1], atol=1e-9)
        read = np.interp(after[:, 0], np.arange(64), symmetry.of_image(columns)[0])
        inside = (before[:, 0] > 0) & (before[:, 0] < 63)
        np.testing.assert_allclose(read[inside], before[inside, 0], atol=1e-9)


@pytest.mark.parametrize("symmetry", ALL, ids=str)
def test_grids_and_points_move_alike(symmetry, rng):
    workspace = Workspace()
    index = np.array([31, 7, 12])
    grid = np.zeros((40, 40, 40))
    grid[tuple(index)] = 1
    matrix = symmetry.matrix(workspace)
    point = matrix[:3, :3] @ workspace.position_of(index) + matrix[:3, 3]
    assert symmetry.of_grid(grid)[tuple(workspace.index_of(point))] == 1


@pytest.mark.parametrize("symmetry", ALL, ids=str)
def test_grasp_axes_move_with_the_scene(symmetry, rng):
    workspace = Workspace()
    rotations = Rotation.random(10, random_state=0)
    moved = Rotation.from_quat(symmetry.of_rotations(rotations.as_quat(), workspace)).as_matrix()
    linear = symmetry.matrix(workspace)[:3, :3]
    for axis in (1, 2):  # the closing axis and the approach
        np.testing.assert_allclose(moved[:, :, axis], rotations.as_matrix()[:, :, axis] @ linear.T, atol=1e-9)


def test_bounds_of_a_mirrored_camera_are_mirrored(make_record):
    workspace = Workspace()
    camera = make_record().cameras[0]
    left, top, right, bottom = camera.bounds
    mirrored = Symmetry(0, True).of_camera(camera, workspace).bounds
    np.testing.assert_allclose(mirrored, (63 - right, top, 63 - left, bottom))


def test_an_augmented_sample_is_the_same_each_time_it_is_made(make_record):
    prepared = prepare_record(make_record(), Workspace(), 64)
    first, second = (sample_of(prepared, Workspace(), np.random.default_rng(5)) for _ in range(2))
    assert torch.equal(first.inputs.views.images, second.inputs.views.images)
    assert torch.equal(first.truth.tsdf, second.truth.tsdf)
    assert torch.equal(first.truth.labels.index, second.truth.labels.index)


def test_labels_lie_on_their_object(make_record):
    """Every success of the ball lies where the distance is small, whatever the symmetry."""
    prepared = prepare_record(make_record(x=0.1, y=0.2), Workspace(), 64)
    for seed in range(6):
        sample = sample_of(prepared, Workspace(), np.random.default_rng(seed))
        x, y, z = sample.truth.labels.index[sample.truth.labels.success].T
        assert (sample.truth.tsdf[x, y, z].abs() < 0.6).all()


def test_another_network_size_keeps_the_geometry(make_record):
    large = sample_of(prepare_record(make_record(size=128), Workspace(), 64), Workspace(), None)
    small = sample_of(prepare_record(make_record(size=64), Workspace(), 64), Workspace(), None)
    torch.testing.assert_close(large.inputs.views.cameras.intrinsics, small.inputs.views.cameras.intrinsics)
    coarse, fine = small.inputs.views.images, large.inputs.views.images
    shifted = [(fine.roll(step, 3) - coarse).abs().mean() for step in (-1, 1)]
    assert (fine - coarse).abs().mean() < 0.7 * min(shifted)


def test_the_ball_is_found_as_change_and_the_table_as_table(make_record):
    record = make_record(size=128)
    prepared = prepare_record(record, Workspace(), 128)
    for view in range(4):
        ball = record.depths[view] < make_record(size=128, x=5.0).depths[view] - 1e-4
        labels = prepared.inputs[view].changes
        assert (labels[ball] == OBJECT).mean() > 0.5
        inside = ndimage.binary_erosion(ball)  # the outline itself is known to a pixel
        assert not (labels[inside] == TABLE).any()
        assert not (labels[~ball] == OBJECT).any()
        assert (labels[~ball] == TABLE).mean() > 0.8


def test_dropping_views_keeps_photos_and_cameras_together(make_record):
    inputs = sample_of(prepare_record(make_record(), Workspace(), 64), Workspace(), None).inputs
    kept = drop_views(inputs, [3, 1])
    assert torch.equal(kept.views.images[0], inputs.views.images[3])
    assert torch.equal(kept.views.cameras.centres[1], inputs.views.cameras.centres[1])
