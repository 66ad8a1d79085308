"""Hand-eye calibration: the true pose comes back, and weak sets are weak."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, from_rotation_vector, inverse, look_at, rotation_about
from neugrasp.robot.hand_eye import Sightings, calibrated, inverses

pytestmark = pytest.mark.skipif(find_spec("cv2") is None, reason="needs neugrasp[capture]")

CAMERA = from_rotation_vector([0.02, -0.05, 1.5], [0.01, 0.08, 0.03])
BOARD = from_rotation_vector([0.1, 0.0, 0.7], [0.5, 0.1, 0.02])
SIZE, FOCAL = (0.2, 0.15), 900.0


def photographed(count: int, seed: int, pose_mm: float, board_px: float) -> Sightings:
    """Views of a board from all sides, with errors of the flange's poses and of the board's."""
    rng = np.random.default_rng(seed)
    flanges, boards = [], []
    for _ in range(count):
        way = np.array([*rng.uniform(-0.25, 0.25, 2), rng.uniform(0.3, 0.5)])
        camera = look_at(BOARD[:3, 3] + way, BOARD[:3, 3] + rng.uniform(-0.03, 0.03, 3))
        camera[:3, :3] = camera[:3, :3] @ rotation_about((0, 0, 1), rng.uniform(-1, 1))
        flange = camera @ inverse(CAMERA)
        flange[:3, 3] += rng.normal(0, pose_mm / 1000, 3)
        flanges.append(flange)
        # A board errs most along the line of sight, and in its tilt.
        shift = rng.normal(0, board_px, 3) * np.array([0.4, 0.4, 3.0]) / FOCAL
        turn = rng.normal(0, board_px, 3) * np.array([5, 5, 1]) / FOCAL
        boards.append(inverse(camera) @ BOARD @ from_rotation_vector(turn) + shifted(shift))
    return Sightings(np.array(flanges), np.array(boards), SIZE, FOCAL)


def shifted(shift: Array) -> Array:
    zero = np.zeros((4, 4))
    zero[:3, 3] = 0.4 * shift
    return zero


def test_without_errors_the_true_pose_comes_back():
    found = calibrated(photographed(12, 0, 0.0, 0.0))
    np.testing.assert_allclose(found.flange_from_camera, CAMERA, atol=1e-7)
    np.testing.assert_allclose(found.base_from_board, BOARD, atol=1e-7)
    assert found.spread_mm < 1e-3
    assert found.problems == ()


@pytest.mark.slow
def test_the_refinement_is_as_good_as_the_best_closed_form_whichever_that_is():
    """Over ten sets with errors of the robot alone, where nothing is better than the best of them."""
    errors = []
    for seed in range(10):
        found = calibrated(photographed(20, seed, 0.7, 0.4))
        assert found.spread_mm <= 1.05 * min(found.solvers_mm.values())
        assert found.spread_mm < max(found.solvers_mm.values())
        errors.append(1000 * np.linalg.norm(found.flange_from_camera[:3, 3] - CAMERA[:3, 3]))
    assert np.mean(errors) < 2.0


@pytest.mark.slow
def test_the_doubt_is_as_large_as_the_error():
    """The error in standard deviations, over sixteen sets."""
    ratios = []
    for seed in range(16):
        found = calibrated(photographed(14, 100 + seed, 0.7, 0.4))
        error = 1000 * np.linalg.norm(found.flange_from_camera[:3, 3] - CAMERA[:3, 3])
        ratios.append(error / found.doubt_mm)
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 3


def test_few_photos_and_poses_that_were_not_measured_are_weak():
    few = calibrated(photographed(6, 1, 0.5, 0.3))
    assert few.problems[0].startswith("6 photos; take 10 or more")
    loose = calibrated(photographed(15, 2, 6.0, 0.3))
    assert any("spreads by" in problem for problem in loose.problems)


def test_a_camera_that_is_never_tilted_cannot_be_calibrated():
    seen = photographed(8, 3, 0.0, 0.0)
    flat = np.tile(seen.base_from_flange[0], (8, 1, 1))
    flat[:, 0, 3] += np.linspace(0, 0.2, 8)
    with pytest.raises(InputError, match="hardly turns"):
        calibrated(replace(seen, base_from_flange=flat))
    with pytest.raises(InputError, match="known in 3 photos; a hand-eye calibration needs 4"):
        calibrated(replace(seen, base_from_flange=flat[:3]))


def test_inverses_are_inverses():
    poses = photographed(5, 4, 1.0, 0.0).base_from_flange
    np.testing.assert_allclose(inverses(poses) @ poses, np.tile(np.eye(4), (5, 1, 1)), atol=1e-12)
