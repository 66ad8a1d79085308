"""Pinhole cameras, and what cropping does to them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from PIL import Image as Picture

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import from_quaternion, look_at

CAMERA = Camera(
    np.array([[459.14, 0, 319.75], [0, 450.0, 179.75], [0, 0, 1]]),
    look_at((0.3, -0.4, 0.6), (0.15, 0.15, 0.05)),
    640,
    360,
)
pixels = st.tuples(st.floats(-0.5, 639.5), st.floats(-0.5, 359.5))
depths = st.floats(0.05, 3)


@given(pixels, depths)
def test_projection_undoes_unprojection(pixel: tuple[float, float], depth: float):
    back, depth_back = CAMERA.project(CAMERA.unproject(pixel, depth))
    np.testing.assert_allclose(back, pixel, atol=1e-7)
    assert depth_back == pytest.approx(depth)


@pytest.mark.slow
@given(pixels, depths, depths)
def test_all_points_of_a_ray_lie_on_one_line_through_the_centre(
    pixel: tuple[float, float], near: float, far: float
):
    assume(abs(near - far) > 1e-3)
    first, second = CAMERA.unproject([pixel, pixel], np.array([near, far]))
    area = np.linalg.norm(np.cross(first - CAMERA.centre, second - CAMERA.centre))
    assert area < 1e-9


def test_x_is_right_y_is_down_and_depth_is_z():
    camera = Camera(np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]]), np.eye(4), 101, 81)
    pixel, depth = camera.project([0.1, 0.2, 0.5])
    np.testing.assert_allclose(pixel, [50 + 20, 40 + 40])
    assert depth == 0.5
    assert camera.project([0, 0, -1.0])[1] < 0


@pytest.mark.slow
@given(
    st.floats(-200, 500),
    st.floats(-200, 250),
    st.floats(20, 700),
    st.floats(20, 700),
    st.integers(16, 300),
    st.integers(16, 300),
    pixels,
    depths,
)
def test_a_crop_sees_a_point_where_the_photo_did(
    left: float,
    top: float,
    wide: float,
    high: float,
    width: int,
    height: int,
    pixel: tuple[float, float],
    depth: float,
):
    crop = CAMERA.cropped_and_resized((left, top, left + wide, top + high), width, height)
    seen, _ = crop.project(CAMERA.unproject(pixel, depth))
    # The share of the way from the box's edge to its other edge is the same before and after.
    np.testing.assert_allclose((seen[0] + 0.5) / width, (pixel[0] - left) / wide, atol=1e-7)
    np.testing.assert_allclose((seen[1] + 0.5) / height, (pixel[1] - top) / high, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.5, 1, 2, 4])
def test_a_pixel_of_a_resized_photo_shows_its_own_column(scale: float):
    """The camera's arithmetic agrees with what an image library does to the pixels."""
    columns = np.broadcast_to(np.arange(640, dtype=np.float32), (360, 640))
    box = (99.5, 39.5, 419.5, 279.5)
    width, height = round(320 * scale), round(240 * scale)
    corners = tuple(edge + 0.5 for edge in box)
    picture = Picture.fromarray(columns).resize((width, height), Picture.Resampling.BILINEAR, box=corners)
    resized = np.asarray(picture)
    crop = CAMERA.cropped_and_resized(box, width, height)
    inner = np.stack(np.meshgrid(np.arange(8, width - 8), np.arange(8, height - 8)), -1).reshape(-1, 2)
    original, _ = CAMERA.project(crop.unproject(inner, np.full(len(inner), 0.5)))
    np.testing.assert_allclose(resized[inner[:, 1], inner[:, 0]], original[:, 0], atol=0.01)


def test_a_crop_past_the_photo_remembers_which_part_was_measured():
    crop = CAMERA.cropped_and_resized((-100.5, -0.5, 259.5, 359.5), 180, 180)
    left, top, right, bottom = crop.bounds
    np.testing.assert_allclose([left, top, right, bottom], [49.5, -0.5, 179.5, 179.5])
    # A crop of the crop still knows it.
    again = crop.cropped_and_resized((39.5, -0.5, 79.5, 39.5), 80, 80)
    np.testing.assert_allclose(again.bounds, [19.5, -0.5, 79.5, 79.5])


def test_moving_the_world_changes_no_picture():
    new_from_world = from_quaternion([0.1, 0.5, -0.3, 0.8], [1, 2, 3])
    point = np.array([0.1, 0.2, 0.1])
    moved_point = new_from_world[:3, :3] @ point + new_from_world[:3, 3]
    np.testing.assert_allclose(
        CAMERA.moved(new_from_world).project(moved_point)[0], CAMERA.project(point)[0], atol=1e-9
    )


def test_the_pixel_grid_is_indexed_by_row_and_column():
    grid = CAMERA.pixel_grid()
    assert grid.shape == (360, 640, 2)
    np.testing.assert_array_equal(grid[3, 7], [7, 3])
