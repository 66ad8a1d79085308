"""The eight symmetries of the workspace: everything in a scene moves together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from neugrasp.geometry.symmetry import SYMMETRIES, Symmetry
from neugrasp.geometry.workspace import Workspace


def test_there_are_eight_and_the_first_does_nothing(rng):
    workspace = Workspace()
    assert len({symmetry.matrix(workspace).tobytes() for symmetry in SYMMETRIES}) == 8
    grid = rng.normal(size=(4, 4, 4))
    assert np.array_equal(SYMMETRIES[0].of_grid(grid), grid)


@pytest.mark.parametrize("symmetry", SYMMETRIES, ids=str)
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


@pytest.mark.parametrize("symmetry", SYMMETRIES, ids=str)
def test_grids_and_points_move_alike(symmetry, rng):
    workspace = Workspace()
    index = np.array([31, 7, 12])
    grid = np.zeros((40, 40, 40))
    grid[tuple(index)] = 1
    matrix = symmetry.matrix(workspace)
    point = matrix[:3, :3] @ workspace.position_of(index) + matrix[:3, 3]
    assert symmetry.of_grid(grid)[tuple(workspace.index_of(point))] == 1


@pytest.mark.parametrize("symmetry", SYMMETRIES, ids=str)
def test_grasp_axes_move_with_the_scene(symmetry, rng):
    workspace = Workspace()
    rotations = Rotation.random(10, random_state=0)
    moved = Rotation.from_quat(symmetry.of_rotations(rotations.as_quat())).as_matrix()
    linear = symmetry.matrix(workspace)[:3, :3]
    for axis in (1, 2):  # the closing axis and the approach
        np.testing.assert_allclose(moved[:, :, axis], rotations.as_matrix()[:, :, axis] @ linear.T, atol=1e-9)


def test_bounds_of_a_mirrored_camera_are_mirrored(make_record):
    workspace = Workspace()
    camera = make_record().cameras[0]
    left, top, right, bottom = camera.bounds
    mirrored = Symmetry(0, True).of_camera(camera, workspace).bounds
    np.testing.assert_allclose(mirrored, (63 - right, top, 63 - left, bottom))


@pytest.mark.parametrize("symmetry", SYMMETRIES, ids=str)
def test_the_inverse_undoes_it(symmetry, rng):
    workspace = Workspace()
    undo = symmetry.inverse
    np.testing.assert_allclose(undo.matrix(workspace) @ symmetry.matrix(workspace), np.eye(4), atol=1e-12)
    grid = rng.normal(size=(6, 6, 6, 4))
    assert np.array_equal(undo.of_grid(symmetry.of_grid(grid)), grid)
    before = Rotation.random(20, random_state=1)
    after = Rotation.from_quat(undo.of_rotations(symmetry.of_rotations(before.as_quat())))
    assert (before.inv() * after).magnitude().max() < 1e-6
