"""What is held goes along in the plans: a box around it, and ways that it would block are refused."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from neugrasp.detection.contract import Detection
from neugrasp.geometry.pose import Array, apply, inverse
from neugrasp.grasp import Grasp, Grasps
from neugrasp.robot.cell_file import CellFile
from neugrasp.robot.errors import NoPlan
from neugrasp.robot.held import held_box
from neugrasp.robot.motion import Motion
from neugrasp.robot.simulated_cameras import TruthCamera
from neugrasp.robot.workcell import planner_of
from neugrasp.simulation.physics import World
from robot_cells import down_at
from toy_boxes import box, boxes_scene, grasp_of

pytestmark = pytest.mark.skipif(find_spec("ompl") is None, reason="needs neugrasp[robot]")

TALL, BESIDE = box(0.15, 0.15, "0.03 0.05 0.12"), box(0.205, 0.15, "0.04 0.05 0.04")
VOXEL = 0.0075


@pytest.fixture(scope="module")
def seen(world: World) -> Detection:
    """The true surface of a tall box with a low one beside it, on the other side of a finger."""
    world.reset(boxes_scene(TALL, BESIDE))
    return Detection(Grasps.of([]), world.workspace, world.gripper, TruthCamera(world).capture().tsdf.values)


@pytest.mark.slow
def test_the_box_is_around_what_is_between_the_fingers_and_nothing_else(seen: Detection):
    grasp = replace(grasp_of(TALL), width=0.03)
    corners = held_box(grasp, seen)
    assert corners is not None
    low, high = corners.min(axis=0), corners.max(axis=0)
    np.testing.assert_allclose(low[:2], [0.135, 0.125], atol=1.5 * VOXEL)
    np.testing.assert_allclose(high[:2], [0.165, 0.175], atol=1.5 * VOXEL)
    assert 0.05 < low[2] < 0.053
    assert high[2] == pytest.approx(0.17, abs=1.5 * VOXEL)


def test_where_nothing_is_seen_nothing_is_held(seen: Detection):
    assert held_box(Grasp(down_at(0.05, 0.05, 0.2), 0.03), seen) is None
    assert held_box(grasp_of(TALL), replace(seen, tsdf=None)) is None


def lowest_of(held: Array, motion: Motion, at: Array, ways: list[Array]) -> float:
    """How low what is held comes, metres above the table, carried from the joints `at` along ways."""
    fence = motion.fence
    local = apply(inverse(fence.world_from_base @ fence.model.flange(at)), held)
    poses = [fence.world_from_base @ fence.model.flange(joints) for way in ways for joints in way]
    return min(float(apply(pose, local)[:, 2].min()) for pose in poses) - 0.05


@pytest.mark.slow
def test_a_way_that_would_sweep_it_through_the_table_is_refused(
    cell: CellFile, motion: Motion, seen: Detection
):
    """Held near its top, the box reaches 10 cm below the TCP: to a low place the empty hand may go, and the
    full one may not."""
    grasp = replace(grasp_of(TALL), width=0.03)
    grasp.pose[2, 3] = 0.155
    held = held_box(grasp, seen)
    assert held is not None
    checker = motion.checker(seen.surface(), 0.006)
    low = motion.solutions(down_at(0.12, -0.16, 0.11), cell.drop)[0]
    empty = motion.pick(cell.out_of_sight, grasp, low, checker)
    assert lowest_of(held, motion, empty.approach.joints[-1], [empty.way_out.joints]) < -0.02
    with pytest.raises(NoPlan):
        motion.pick(cell.out_of_sight, grasp, low, checker, held)
    high = motion.solutions(down_at(0.12, -0.16, 0.22), cell.drop)[0]
    full = motion.pick(cell.out_of_sight, grasp, high, checker, held)
    ways = [full.retreat.joints, full.way_out.joints]
    assert lowest_of(held, motion, full.approach.joints[-1], ways) > -0.002


WALLS = tuple(
    box(0.15 + x, 0.15 + y, "0.03 0.03 0.18") for x, y in ((0.11, 0), (-0.11, 0), (0, 0.11), (0, -0.11))
)


def within(points: Array, size: Array, at: Array) -> Array:
    return np.all(np.abs(points - at) < size / 2, axis=-1)


@pytest.mark.slow
def test_it_is_carried_past_what_stands_around(cell: CellFile, motion: Motion, world: World):
    """It hangs 10 cm below the TCP among towers that are higher than its lower end after the retreat."""
    world.reset(boxes_scene(TALL, *WALLS))
    seen = Detection(Grasps.of([]), world.workspace, world.gripper, TruthCamera(world).capture().tsdf.values)
    grasp = replace(grasp_of(TALL), width=0.03)
    grasp.pose[2, 3] = 0.155
    held = held_box(grasp, seen)
    assert held is not None
    plan = motion.pick(cell.out_of_sight, grasp, cell.drop, motion.checker(seen.surface(), 0.006), held)
    shares = np.stack(np.meshgrid(*[np.linspace(0, 1, count) for count in (5, 7, 17)]), axis=-1).reshape(
        -1, 3
    )
    points = held.min(axis=0) + shares * (held.max(axis=0) - held.min(axis=0))
    fence = motion.fence
    flange = fence.world_from_base @ fence.model.flange(plan.approach.joints[-1])
    local = apply(inverse(flange), points)
    for joints in (*plan.retreat.joints, *plan.way_out.joints):
        carried = apply(fence.world_from_base @ fence.model.flange(joints), local)
        for wall in WALLS:
            size = np.array([float(edge) for edge in wall.name.split()])
            assert not within(carried, size, np.array(wall.position)).any()


@pytest.mark.slow
def test_fingers_that_swing_stand_deeper_and_close_at_the_grasp(cell: CellFile, seen: Detection):
    """A cell of hardware: its 2F-85 has the arc that the twin's straight fingers lack."""
    driver = replace(cell.arm, driver="ur")
    real = planner_of(replace(cell, arm=driver))
    grasp = replace(grasp_of(TALL), width=0.03)
    checker = real.checker(seen.surface(), 0.006)
    plan = real.pick(cell.out_of_sight, grasp, cell.drop, checker, held_box(grasp, seen))
    deeper = float(cell.gripper.gripper.tip_setback(0.03))
    assert deeper > 0.0005
    stands = real.tcp(plan.approach.joints[-1])[:3, 3]
    np.testing.assert_allclose(stands, grasp.position + deeper * grasp.approach, atol=1e-9)
