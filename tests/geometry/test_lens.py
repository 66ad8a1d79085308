"""A lens bends as OpenCV says, and a photo comes out as an ideal pinhole would have taken it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.lens import Lens
from neugrasp.geometry.pose import look_at
from neugrasp.importers.foreign_lens import lens_from_corner
from neugrasp.importers.resampling import full_rectangle, is_inside, resampled, seen_on_table

INTRINSICS = np.array([[90.0, 0, 47.0], [0, 92.0, 33.5], [0, 0, 1]])
small = st.floats(-0.05, 0.05)


@settings(max_examples=30, deadline=None)
@given(small, small, small, st.floats(-0.01, 0.01), st.floats(-0.01, 0.01))
def test_it_bends_as_opencv_does(k1: float, k2: float, k3: float, p1: float, p2: float):
    cv2 = pytest.importorskip("cv2")
    lens = Lens(INTRINSICS, 96, 64, (k1, k2, k3), (p1, p2))
    pixels = lens.pixel_grid()[::7, ::7].reshape(-1, 2)
    points = np.concatenate([lens.normalised(pixels), np.ones((len(pixels), 1))], axis=-1)
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), INTRINSICS, lens.coefficients)
    np.testing.assert_allclose(lens.distorted(pixels), expected.reshape(-1, 2), atol=1e-9)


def test_the_first_pixel_counts_from_its_corner_elsewhere():
    lens = lens_from_corner((90, 92), (48, 32), (96, 64), "here")
    np.testing.assert_array_equal(lens.intrinsics[:2, 2], (47.5, 31.5))
    with pytest.raises(InputError, match="here: focal lengths -90 and 92 must be positive"):
        lens_from_corner((-90, 92), (48, 32), (96, 64), "here")


@pytest.mark.parametrize("k1", [-0.15, 0.15])
def test_a_bent_photo_becomes_straight(k1: float):
    """A photo whose colour is a linear function of the ideal pixel reads back as that function."""
    lens = Lens(INTRINSICS, 96, 64, (k1, 0.01, 0.0), (0.003, -0.002))
    grid = lens.pixel_grid()
    ideal = grid.copy()
    for _ in range(40):
        ideal += grid - lens.distorted(ideal)
    bent = np.stack([ideal[..., 0], ideal[..., 1], 0 * ideal[..., 0]], axis=-1) + 20
    places = lens.distorted(grid)
    straight = resampled(bent.round().clip(0, 255).astype(np.uint8), places)
    inside = is_inside(lens, places)
    assert inside.mean() > 0.8
    np.testing.assert_allclose(straight[inside][:, :2], grid[inside] + 20, atol=1.01)


def test_beyond_the_turning_point_there_is_nothing():
    """With k1 = -0.4 the radius turns back at 1 / sqrt(1.2) = 0.913 of the focal length."""
    lens = Lens(np.array([[40.0, 0, 63.5], [0, 40.0, 47.5], [0, 0, 1]]), 128, 96, (-0.4, 0.0, 0.0))
    radius = np.linalg.norm(lens.normalised(lens.pixel_grid()), axis=-1)
    is_nothing = np.isnan(lens.distorted(lens.pixel_grid())[..., 0])
    assert not is_nothing[radius < 0.90].any()
    assert is_nothing[radius > 0.93].all()
    assert not is_inside(lens, lens.distorted(lens.pixel_grid()))[is_nothing].any()


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 9), st.integers(0, 9), st.integers(0, 9), st.integers(0, 9))
def test_the_full_rectangle_is_what_borders_leave(top: int, left: int, bottom: int, right: int):
    inside = np.zeros((30, 40), dtype=bool)
    inside[top : 30 - bottom, left : 40 - right] = True
    expected = None if inside.all() else (left - 0.5, top - 0.5, 39.5 - right, 29.5 - bottom)
    assert full_rectangle(inside) == expected


def test_the_full_rectangle_of_any_mask_is_full(rng: np.random.Generator):
    for share in (0.0, 0.02, 0.5, 1.0):
        inside = rng.random((20, 30)) >= share
        found = full_rectangle(inside)
        left, top, right, bottom = found or (-0.5, -0.5, 29.5, 19.5)
        assert inside[round(top + 0.5) : round(bottom + 0.5), round(left + 0.5) : round(right + 0.5)].all()


def test_what_is_seen_on_the_table_is_where_the_other_camera_sees_it(rng: np.random.Generator):
    lens = Lens(INTRINSICS, 96, 64)
    table = np.array([0.0, 0.6, 0.8, 0.3])
    one, other = (
        Camera(INTRINSICS, look_at(eye, (0.1, 0.3, 0.1)), 96, 64)
        for eye in ((0.4, 0.5, 0.7), (0.3, 0.6, 0.75))
    )
    places = seen_on_table(lens, one.world_from_camera, other.world_from_camera, table)
    eye = one.centre
    towards = one.unproject(lens.pixel_grid(), np.ones((64, 96))) - eye
    points = eye + towards * ((table[3] - table[:3] @ eye) / (towards @ table[:3]))[..., None]
    np.testing.assert_allclose(points @ table[:3], table[3], atol=1e-9)
    expected, depth = other.project(points)
    assert (depth > 0).all()
    np.testing.assert_allclose(places, expected, atol=1e-8)


def test_above_the_horizon_there_is_no_table():
    lens = Lens(INTRINSICS, 96, 64)
    level = look_at((0, 0, 0.5), (1, 0, 0.5))
    places = seen_on_table(lens, level, level, np.array([0.0, 0.0, 1.0, 0.0]))
    assert np.isnan(places[:33]).all()
    np.testing.assert_allclose(places[35:], lens.pixel_grid()[35:], atol=1e-9)
