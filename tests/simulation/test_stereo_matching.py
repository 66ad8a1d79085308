"""Depth from pairs that were made by shifting one image."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from neugrasp.geometry.view_sets import view_set
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.cell import sample_cell
from neugrasp.simulation.infrared import infrared_pair, infrared_sensor
from neugrasp.simulation.stereo_matching import StereoConfig, stereo_depth

FOCAL = 230.0
CONFIG = StereoConfig()


def dots(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    image = gaussian_filter((rng.random(shape) < 0.06).astype(np.float64), 0.8)
    return (255 * image / image.max()).astype(np.float32)


def pair(depth: np.ndarray, rng: np.random.Generator, offset: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A left image of dots on a surface of this depth (by column of the right image), and the right one."""
    height, width = depth.shape
    left = dots((height, width), rng)
    rows, columns = np.indices((height, width + offset))
    wide = np.pad(depth, ((0, 0), (offset, 0)), mode="edge")
    disparity = FOCAL * CONFIG.baseline / wide
    right = map_coordinates(left, (rows, columns - offset + disparity), order=3, mode="nearest")
    return left, right.astype(np.float32)


@pytest.mark.parametrize("distance", [0.3, 0.41, 0.5, 0.7])
@pytest.mark.parametrize("offset", [0, 40])
def test_a_wall_is_where_it_is(distance: float, offset: int, rng: np.random.Generator):
    left, right = pair(np.full((60, 160), distance), rng, offset)
    depth = stereo_depth(left, right, offset, FOCAL, CONFIG)[:, 60:-10]
    assert (depth > 0).mean() > 0.95
    step = distance**2 / (FOCAL * CONFIG.baseline)
    assert np.median(np.abs(depth[depth > 0] - distance)) < 0.1 * step


def test_a_slope_is_measured_to_a_fraction_of_a_pixel(rng: np.random.Generator):
    truth = np.broadcast_to(np.linspace(0.4, 0.5, 60)[:, None], (60, 200))
    left, right = pair(truth, rng)
    depth = stereo_depth(left, right, 0, FOCAL, CONFIG)[:, 60:-10]
    valid = depth > 0
    error = np.abs(depth - truth[:, 60:-10])[valid]
    assert valid.mean() > 0.8
    # A pixel of disparity is 16 mm here.
    assert np.median(error) < 0.002


def test_what_has_no_contrast_or_no_partner_is_not_measured(rng: np.random.Generator):
    flat = np.full((40, 120), 80.0, dtype=np.float32)
    assert not stereo_depth(flat, flat, 0, FOCAL, CONFIG).any()
    one, other = dots((40, 160), rng), dots((40, 160), rng)
    by_chance = stereo_depth(one, other, 0, FOCAL, CONFIG) > 0
    left, right = pair(np.full((40, 160), 0.5), rng)
    measured = stereo_depth(left, right, 0, FOCAL, CONFIG) > 0
    assert by_chance.mean() < 0.6 * measured.mean()


def test_a_gain_and_an_offset_between_the_cameras_do_not_matter(rng: np.random.Generator):
    left, right = pair(np.full((40, 160), 0.5), rng)
    plain = stereo_depth(left, right, 0, FOCAL, CONFIG)
    brighter = stereo_depth(left, 0.7 * right + 20, 0, FOCAL, CONFIG)
    assert ((plain > 0) == (brighter > 0)).mean() > 0.98
    both = (plain > 0) & (brighter > 0)
    assert (np.abs(plain[both] / brighter[both] - 1) < 0.01).mean() > 0.98


def test_both_cameras_see_a_point_of_the_table_a_disparity_apart(workspace: Workspace):
    cell = sample_cell(workspace, "released", 1, "test", size=32, num_targets=0)
    for sensor in view_set("released", workspace, np.random.default_rng(0)):
        small = infrared_sensor(sensor, 0.5)
        focal = float(small.intrinsics[0, 0])
        assert focal == pytest.approx(459.14 / 2)
        stereo, offset = infrared_pair(cell, small, workspace, CONFIG.baseline, 60)
        left, right = stereo.cameras
        (u, v), depth = left.project((0.16, 0.13, 0.07))
        (u2, v2), depth2 = right.project((0.16, 0.13, 0.07))
        assert depth == pytest.approx(depth2)
        assert v == pytest.approx(v2)
        assert u + offset - u2 == pytest.approx(focal * CONFIG.baseline / depth)
        assert (left.width <= 320, left.height <= 180) == (True, True)
        np.testing.assert_allclose(left.world_from_camera, sensor.world_from_camera)
        assert stereo.light["projector"]["energy"] > 0
        assert stereo.light["strength"] < 0.05 * cell.light["strength"]
