"""Fusion of depth images against surfaces that are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.fusion import fuse, vgn_grid
from neugrasp.geometry.pose import apply, inverse, look_at
from neugrasp.geometry.workspace import Workspace

WORKSPACE = Workspace()
EYES = [(0.15, 0.15, 0.7), (0.5, 0.15, 0.5), (-0.1, -0.1, 0.5), (0.1, 0.5, 0.6)]


def camera_at(eye: tuple[float, float, float], focal: float = 460.0, size: int = 400) -> Camera:
    middle = (size - 1) / 2
    intrinsics = np.array([[focal, 0, middle], [0, focal, middle], [0, 0, 1.0]])
    return Camera(intrinsics, look_at(eye, WORKSPACE.centre), size, size)


def rays(camera: Camera) -> np.ndarray:
    """Directions (h, w, 3) with unit z-depth, workspace frame."""
    return camera.unproject(camera.pixel_grid(), np.ones((camera.height, camera.width))) - camera.centre


def table_depth(camera: Camera) -> np.ndarray:
    return ((WORKSPACE.table_height - camera.centre[2]) / rays(camera)[..., 2]).astype(np.float32)


def sphere_depth(camera: Camera, centre: np.ndarray, radius: float) -> np.ndarray:
    """z-depth of a ball, 0 beside it."""
    direction, to_camera = rays(camera), camera.centre - centre
    a = np.sum(direction**2, axis=-1)
    b, c = direction @ to_camera, to_camera @ to_camera - radius**2
    root = b**2 - a * c
    return np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, 0).astype(np.float32)


def test_a_table_seen_from_straight_above_is_its_height_over_the_truncation() -> None:
    far = camera_at((0.15, 0.15, 1.9), focal=2000.0)
    values = fuse([table_depth(far)], [far], WORKSPACE).values
    heights = (np.arange(40) + 0.5) * 0.0075 - 0.05
    expected = np.where(heights > -0.03, np.minimum(heights / 0.03, 1), -1)
    # The ray is at most 1 percent longer than its vertical part under this narrow angle.
    np.testing.assert_allclose(values, np.broadcast_to(expected, (40, 40, 40)), atol=0.02)


def test_one_view_gives_the_ray_distance_exactly() -> None:
    """The value of a voxel is (depth - z) |ray| / truncation at the pixel nearest to its projection."""
    camera = camera_at(EYES[1])
    tsdf = fuse([table_depth(camera)], [camera], WORKSPACE)
    x, y, z = 12, 25, 8
    centre = (np.array([x, y, z]) + 0.5) * 0.0075
    in_camera = apply(inverse(camera.world_from_camera), centre)
    pixel = camera.project(centre)[0]
    column, row = np.floor(pixel + 0.5).astype(int)
    distance = (table_depth(camera)[row, column] - in_camera[2]) * np.linalg.norm(in_camera / in_camera[2])
    assert abs(distance) < 0.03
    assert tsdf.values[x, y, z] == pytest.approx(distance / 0.03, abs=1e-6)
    assert tsdf.weight[x, y, z] == 1


def test_a_ball_is_where_it_is_and_axes_are_not_swapped() -> None:
    centre, radius = np.array([0.10, 0.17, 0.12]), 0.05
    cameras = [camera_at(eye) for eye in EYES]
    tsdf = fuse([sphere_depth(camera, centre, radius) for camera in cameras], cameras, WORKSPACE)
    points = WORKSPACE.voxel_centres()
    signed = np.linalg.norm(points - centre, axis=-1) - radius
    surface = tsdf.observed & (np.abs(tsdf.values) < 0.15)
    assert surface.sum() > 100
    # Seen from four sides, a projective distance near zero lies near the surface.
    assert np.abs(signed[surface]).max() < 0.0075
    found = points[surface].mean(axis=0)
    np.testing.assert_allclose(found[:2], centre[:2], atol=0.01)


def test_unseen_is_minus_one_and_free_space_plus_one() -> None:
    camera = camera_at(EYES[0])
    depth = table_depth(camera)
    tsdf = fuse([depth], [camera], WORKSPACE)
    assert np.all(tsdf.values[~tsdf.observed] == -1)
    assert tsdf.values[20, 20, 38] == 1
    assert tsdf.values[20, 20, 0] == -1
    nothing = fuse([np.zeros_like(depth)], [camera], WORKSPACE)
    assert not nothing.observed.any()
    beyond = fuse([np.full_like(depth, 2.1), np.full_like(depth, np.nan)], [camera, camera], WORKSPACE)
    assert not beyond.observed.any()


def test_the_average_does_not_depend_on_the_order_of_views() -> None:
    cameras = [camera_at(eye) for eye in EYES]
    depths = [table_depth(camera) for camera in cameras]
    forward, backward = fuse(depths, cameras, WORKSPACE), fuse(depths[::-1], cameras[::-1], WORKSPACE)
    np.testing.assert_allclose(forward.values, backward.values, atol=1e-6)
    np.testing.assert_array_equal(forward.weight, backward.weight)


def test_the_grid_of_vgn_holds_only_the_band_around_the_surface() -> None:
    camera = camera_at(EYES[0])
    tsdf = fuse([table_depth(camera)], [camera], WORKSPACE)
    grid = vgn_grid(tsdf)
    band = tsdf.observed & (tsdf.values < 0.98) & (tsdf.values >= -0.98)
    np.testing.assert_allclose(grid[band], (tsdf.values[band] + 1) / 2)
    assert np.all(grid[~band] == 0)
    assert grid[20, 20, 6] == pytest.approx(0.5, abs=0.15)
    assert grid[20, 20, 38] == 0
