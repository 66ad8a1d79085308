"""The hand against a known surface: a box on a table, gripped well, from too low, and beside it."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree

from neugrasp.detection.collision_filter import DEEPER, CollisionFilter
from neugrasp.detection.decode import Prediction, SelectionConfig, select_grasps, stored
from neugrasp.geometry.pose import rigid, rotation_about
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper

WORKSPACE = Workspace()
HALF = np.array([0.02, 0.02, 0.06])
CENTRE = np.array([0.15, 0.15, WORKSPACE.table_height + 0.06])
DOWN = np.diag([1.0, -1.0, -1.0])
"""Approach from above, fingers closing along y."""


def box_on_a_table(half: np.ndarray = HALF, centre: np.ndarray = CENTRE) -> np.ndarray:
    """Its exact signed distance, truncated."""
    points = WORKSPACE.voxel_centres()
    q = np.abs(points - centre) - half
    box = np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(axis=-1), 0)
    table = points[..., 2] - WORKSPACE.table_height
    return (np.minimum(box, table) / WORKSPACE.truncation).clip(-1, 1).astype(np.float32)


def passes(
    gripper: Gripper, position: tuple[float, float, float], turn: np.ndarray = DOWN
) -> tuple[bool, bool]:
    poses = rigid(turn, position)[None]
    holds, is_free = CollisionFilter(gripper).passes(box_on_a_table(), WORKSPACE, poses, np.zeros(len(poses)))
    return bool(holds[0]), bool(is_free[0])


@pytest.mark.parametrize("name", ["panda", "robotiq_2f85"])
def test_a_box_between_the_fingers_is_held(name: str):
    gripper = Gripper.load(name)
    above, half_a_turn = (0.15, 0.15, CENTRE[2] + 0.04), rotation_about((0, 0, 1), np.pi)
    assert passes(gripper, above) == (True, True)
    assert passes(gripper, above, DOWN @ half_a_turn) == (True, True)


@pytest.mark.parametrize("name", ["panda", "robotiq_2f85"])
@pytest.mark.parametrize(
    ("position", "expected"),
    [
        pytest.param((0.15, 0.15 + 0.04, CENTRE[2] + 0.04), (True, False), id="a finger in the box"),
        pytest.param((0.15, 0.15, CENTRE[2] - 0.03), (True, False), id="the palm in the box"),
        pytest.param((0.08, 0.08, CENTRE[2] + 0.04), (False, True), id="beside the box"),
        pytest.param((0.15, 0.15, CENTRE[2] + 0.1), (False, True), id="above the box"),
        pytest.param((0.08, 0.08, WORKSPACE.table_height - 0.01), (True, False), id="fingers in the table"),
    ],
)
def test_what_cannot_be_held_is_told_by_its_cause(name: str, position, expected):
    assert passes(Gripper.load(name), position) == expected


@pytest.mark.parametrize("name", ["panda", "robotiq_2f85"])
def test_a_hand_goes_as_deep_as_the_surface_lets_it(name: str):
    gripper = Gripper.load(name)
    top, table = CENTRE[2] + HALF[2], WORKSPACE.table_height
    palm = top + (gripper.palm_height - gripper.tcp_height)
    tips = table + (gripper.tip_height - gripper.tcp_height)
    most = DEEPER * gripper.finger_depth
    expected = {
        "palm 8 mm over the top": ((0.15, 0.15, palm + 0.008), 0.008),
        "palm far over the top": ((0.15, 0.15, palm + most + 0.02), most),
        "tips 8 mm over the table": ((0.06, 0.06, tips + 0.008), 0.008),
        "tips in the table": ((0.06, 0.06, tips - 0.008), 0.0),
        "finger in the box": ((0.15, 0.19, palm + 0.02), 0.0),
    }
    places, room = zip(*expected.values(), strict=True)
    poses = np.stack([rigid(DOWN, place) for place in places])
    found = CollisionFilter(gripper).depth_margin(box_on_a_table(), WORKSPACE, poses, np.zeros(len(poses)))
    assert dict(zip(expected, found, strict=True)) == pytest.approx(
        dict(zip(expected, room, strict=True)), abs=3e-3
    )
    assert CollisionFilter(gripper).depth_margin(
        box_on_a_table(), WORKSPACE, np.empty((0, 4, 4)), np.empty(0)
    ).shape == (0,)


@pytest.mark.parametrize("name", ["panda", "robotiq_2f85"])
def test_the_skin_is_dense_and_lies_on_the_hand(name: str):
    """Every corner of the hand is a point, no point sticks out, and no gap is wider than 2.4 cm."""
    gripper = Gripper.load(name)
    hand = CollisionFilter(gripper)
    points = np.concatenate([hand.fingers, hand.palm]) + np.array([0, 0, gripper.tcp_height])
    mount = np.array([0, gripper.max_opening / 2, gripper.finger_mount])
    hulls = [*gripper.palm.hulls, *(hull + mount for hull in gripper.finger.hulls)]
    hulls += [(hull + mount) * [-1, -1, 1] for hull in gripper.finger.hulls]
    signed = np.stack(
        [(points @ e[:, :3].T + e[:, 3]).max(axis=1) for e in (ConvexHull(hull).equations for hull in hulls)]
    )
    np.testing.assert_array_less(signed.min(axis=0), 1e-9)
    rng = np.random.default_rng(0)
    for hull in hulls:
        triangles = hull[ConvexHull(hull).simplices]
        areas = np.linalg.norm(
            np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
        )
        chosen = rng.choice(len(triangles), 400, p=areas / areas.sum())
        weights = rng.dirichlet((1, 1, 1), 400)
        places = np.einsum("nk,nkd->nd", weights, triangles[chosen])
        assert cKDTree(points).query(places)[0].max() < 0.012


def test_the_check_does_not_depend_on_where_the_voxels_are_cut():
    """Moved with its scene by whole voxels, or turned by a quarter with it, a grasp is judged alike."""
    probe = CollisionFilter(Gripper.load("panda"))
    rng = np.random.default_rng(0)
    points = CENTRE + rng.uniform(-0.05, 0.05, size=(60, 3))
    poses = np.stack([rigid(DOWN @ rotation_about((0, 0, 1), rng.uniform(0, 3)), point) for point in points])
    tsdf = box_on_a_table()
    quarter = rigid(rotation_about((0, 0, 1), np.pi / 2))
    middle = rigid(translation=(0.15, 0.15, 0))
    turned = middle @ quarter @ np.linalg.inv(middle) @ poses
    grid = np.ascontiguousarray(np.rot90(tsdf, 1, axes=(0, 1)))
    for measure in (partial(probe.clearance, widths=np.full(60, 0.04)), probe.pad_fill):
        np.testing.assert_allclose(
            measure(tsdf, WORKSPACE, poses), measure(grid, WORKSPACE, turned), atol=2e-5
        )


def straight_down(tsdf: np.ndarray, *peaks: tuple[int, ...]) -> Prediction:
    """Good grasps from above around each of the voxels `peaks`, which are the best."""
    quality = np.zeros_like(tsdf)
    for x, y, z in peaks:
        quality[x - 4 : x + 5, y - 4 : y + 5, z - 4 : z + 5] = 0.95
        quality[x, y, z] = 1.0
    rotation = np.zeros((4, *tsdf.shape), dtype=np.float32)
    rotation[0] = 1.0
    return Prediction(tsdf, quality, np.full_like(tsdf, 5.0), stored(rotation))


@pytest.mark.parametrize(
    ("peak", "reason"),
    [
        ((20, 20, 25), None),
        ((6, 6, 33), "nothing_between_the_fingers"),
        ((20, 25, 25), "hand_would_collide"),
    ],
)
def test_selection_counts_what_the_hand_forbids(peak: tuple[int, int, int], reason: str | None):
    gripper, tsdf = Gripper.load("panda"), box_on_a_table()
    prediction = straight_down(tsdf, peak)
    blind = select_grasps(prediction, WORKSPACE, gripper)
    assert len(blind.grasps) == 1
    checked = select_grasps(prediction, WORKSPACE, gripper, SelectionConfig(hand=CollisionFilter(gripper)))
    assert len(checked.grasps) == (reason is None)
    for deeper, grasp in zip(checked.grasps, blind.grasps, strict=False):
        way = deeper.position - grasp.position
        assert 0 < way @ grasp.approach <= DEEPER * gripper.finger_depth + 1e-9
        np.testing.assert_allclose(np.cross(way, grasp.approach), 0, atol=1e-12)
    if reason is not None:
        assert checked.rejected[reason] == 1
    assert len(checked.grasps) + sum(checked.rejected.values()) == tsdf.size


@pytest.mark.parametrize("with_better", [False, True])
def test_a_rim_is_held_only_where_nothing_better_is(with_better: bool):
    """Two posts, one of them on a block that the fingers stand on before they get far."""
    gripper, aside = Gripper.load("panda"), np.array([0.06, 0, 0])
    block = box_on_a_table(np.array([0.05, 0.05, 0.0425]), np.array([*(CENTRE + aside)[:2], 0.0925]))
    posts = [box_on_a_table(HALF, CENTRE - aside), box_on_a_table(HALF, CENTRE + aside)]
    tsdf = np.minimum.reduce([*posts, block])
    sides = (1, -1) if with_better else (1,)
    peaks = [WORKSPACE.index_of(CENTRE + side * aside + [0, 0, 0.08]) for side in sides]
    config = SelectionConfig(hand=CollisionFilter(gripper))
    chosen = select_grasps(straight_down(tsdf, *peaks), WORKSPACE, gripper, config)
    assert len(chosen.grasps) == 1
    assert (chosen.grasps[0].position[0] < CENTRE[0]) == with_better
    assert chosen.rejected.get("held_by_the_rim", 0) == with_better
