"""The cube: metres, voxels, and the [-1, 1] cube are one space."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import look_at, rigid
from neugrasp.geometry.workspace import Workspace

inside = st.floats(0, 0.2999999)
WORKSPACE = Workspace()


@given(inside, inside, inside)
def test_a_point_lies_within_half_a_voxel_of_its_voxel_centre(x: float, y: float, z: float):
    index = WORKSPACE.index_of([x, y, z])
    centre = WORKSPACE.position_of(index)
    assert np.all(np.abs(centre - [x, y, z]) <= WORKSPACE.voxel_size / 2 + 1e-12)
    assert WORKSPACE.contains([x, y, z])


@pytest.mark.slow
@given(st.tuples(*[st.integers(0, 39)] * 3))
def test_a_voxel_centre_belongs_to_its_voxel(index: tuple[int, int, int]):
    centre = WORKSPACE.voxel_centres()[index]
    np.testing.assert_allclose(centre, (np.array(index) + 0.5) * 0.0075)
    np.testing.assert_array_equal(WORKSPACE.index_of(centre), index)
    np.testing.assert_allclose(WORKSPACE.position_of(index), centre)


def test_the_unit_cube_has_the_faces_of_the_cube():
    corners = torch.from_numpy(WORKSPACE.corners())
    torch.testing.assert_close(WORKSPACE.to_unit(corners).abs(), torch.ones(8, 3, dtype=torch.float64))
    middle = torch.full((1, 3), 0.15)
    torch.testing.assert_close(WORKSPACE.to_unit(middle), torch.zeros(1, 3))


def test_what_lies_outside_is_not_contained():
    assert not WORKSPACE.contains([0.15, 0.15, 0.3])
    assert not WORKSPACE.contains([-1e-9, 0.15, 0.1])


def test_corners_of_a_slice():
    corners = WORKSPACE.corners(0.04, 0.2)
    assert len({tuple(corner) for corner in corners.tolist()}) == 8
    assert sorted(set(corners[:, 2].tolist())) == [0.04, 0.2]


@pytest.mark.slow
@given(st.floats(0.3, 0.8), st.floats(0, 1.2), st.floats(0, 6.28))
def test_the_photo_box_shows_the_workspace_that_the_photo_shows(radius: float, polar: float, azimuth: float):
    offset = np.array([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    pose = look_at(WORKSPACE.centre + radius * offset, WORKSPACE.centre)
    camera = Camera(np.array([[459.14, 0, 319.75], [0, 459.14, 179.75], [0, 0, 1]]), pose, 640, 360)
    left, top, right, bottom = WORKSPACE.photo_box(camera)
    assert right - left == pytest.approx(bottom - top)
    centres = WORKSPACE.voxel_centres()
    points = np.concatenate([part.reshape(-1, 3) for part in (centres[:, :, 6], centres[4:-4, 4:-4, 6:19])])
    pixels, depth = camera.project(points)
    in_photo = (depth > 0.01) & np.all((pixels >= -0.5) & (pixels < (639.5, 359.5)), axis=-1)
    crop = camera.cropped_and_resized((left, top, right, bottom), 256, 256)
    cropped, _ = crop.project(points)
    lower, upper = np.array(crop.bounds[:2]), np.array(crop.bounds[2:])
    in_crop = np.all((cropped >= lower - 1e-6) & (cropped <= upper + 1e-6), axis=-1)
    np.testing.assert_array_equal(in_crop[in_photo], True)


def test_the_workspace_knows_its_place_in_the_world():
    placed = Workspace(world_from_workspace=rigid(translation=(1, 2, 3)))
    np.testing.assert_allclose(placed.to_world([0.1, 0.1, 0.1]), [1.1, 2.1, 3.1])
