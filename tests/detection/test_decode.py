"""Grasp volume to grasps: positions, the mask, suppression and the count of what fell out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from neugrasp.detection.decode import (
    Prediction,
    SelectionConfig,
    decode_grasp,
    encode_grasp,
    near_surface,
    select_grasps,
    stored,
)
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper

GRIPPER = Gripper.load("panda")


def prediction(peaks: dict[tuple[int, int, int], float], width: float = 5.0) -> Prediction:
    """An empty table with blobs of quality that are `peaks` high after smoothing."""
    workspace = Workspace()
    heights = workspace.voxel_centres()[..., 2]
    tsdf = ((heights - workspace.table_height) / workspace.truncation).clip(-1, 1).astype(np.float32)
    quality = np.zeros((40, 40, 40), dtype=np.float32)
    for (x, y, z), value in peaks.items():
        quality[x - 4 : x + 5, y - 4 : y + 5, z - 4 : z + 5] = value
        quality[x, y, z] = min(1.0, value + 0.01)
    rotation = np.zeros((4, 40, 40, 40), dtype=np.float32)
    rotation[0] = 1.0  # half a turn about x: approach straight down
    return Prediction(tsdf, quality, np.full((40, 40, 40), width, dtype=np.float32), stored(rotation))


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(
    st.tuples(*[st.integers(0, 39)] * 3),
    st.integers(0, 10_000),
    st.floats(1.0, 10.0),
    st.sampled_from(["panda", "robotiq_2f85"]),
)
def test_encoding_a_decoded_grasp_gives_its_voxel_back(index, seed, width, name):
    workspace, gripper = Workspace(), Gripper.load(name)
    quaternion = Rotation.random(random_state=seed).as_quat()
    grasp = decode_grasp(workspace, gripper, index, quaternion, width * workspace.voxel_size, 0.9)
    voxel, same, same_width = encode_grasp(workspace, gripper, grasp)
    assert tuple(voxel) == index
    assert abs(abs(same @ quaternion) - 1) < 1e-9
    assert same_width == pytest.approx(width)


def test_the_tcp_lies_ahead_of_the_voxel_along_the_approach():
    workspace = Workspace()
    selection = select_grasps(prediction({(20, 10, 20): 0.97}), workspace, GRIPPER)
    expected = workspace.position_of((20, 10, 20)) - np.array([0, 0, GRIPPER.tcp_depth])
    best = selection.grasps[0]
    np.testing.assert_allclose(best.position, expected, atol=1e-9)
    np.testing.assert_allclose(best.approach, (0, 0, -1), atol=1e-12)
    assert best.width == pytest.approx(5 * workspace.voxel_size)


@pytest.mark.slow
def test_the_border_of_the_cube_costs_no_score():
    """The smoothing repeats the border; with zeros beyond it, half of a score there would be lost."""
    flat = prediction({})
    flat.quality[...] = 0.95
    selection = select_grasps(flat, Workspace(), GRIPPER)
    assert selection.rejected["quality_below_threshold"] == 0
    assert min(grasp.score for grasp in selection.grasps) == pytest.approx(0.95, abs=1e-5)


def test_grasps_come_best_first_and_every_voxel_is_accounted_for():
    selection = select_grasps(prediction({(10, 10, 20): 0.93, (30, 30, 20): 0.98}), Workspace(), GRIPPER)
    scores = [grasp.score for grasp in selection.grasps]
    assert scores == sorted(scores, reverse=True)
    assert selection.grasps[0].position[0] == pytest.approx(30.5 * 0.0075)
    assert len(selection.grasps) + sum(selection.rejected.values()) == 40**3


@pytest.mark.parametrize(("width", "reason"), [(1.0, "too_narrow"), (10.0, "too_wide_for_the_gripper")])
def test_widths_that_the_gripper_cannot_take_are_counted(width, reason):
    selection = select_grasps(prediction({(20, 20, 20): 0.97}, width), Workspace(), GRIPPER)
    assert selection.grasps == ()
    assert selection.rejected[reason] > 0


def test_an_empty_result_says_how_near_the_best_came():
    selection = select_grasps(prediction({(20, 20, 20): 0.8}), Workspace(), GRIPPER)
    assert selection.grasps == ()
    assert selection.best_rejected == pytest.approx(0.8, abs=0.01)


def test_nothing_is_grasped_deep_inside_matter():
    tsdf = np.full((40, 40, 40), -1.0, dtype=np.float32)
    tsdf[:, :, 20:] = 1.0
    tsdf[:, :, 19] = -0.5
    allowed = near_surface(tsdf, SelectionConfig())
    assert allowed[:, :, 20:].all()
    assert not allowed[:, :, 19].any()
    assert not allowed[:, :, :15].any()
