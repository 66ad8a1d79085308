"""Ways of an arm: where they lead, how fast, and that an independent library finds nothing in them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from neugrasp.detection.contract import Detection
from neugrasp.geometry.pose import Array, rigid, rotation_about
from neugrasp.grasp import Grasp, Grasps
from neugrasp.robot.cell_file import CellFile
from neugrasp.robot.errors import InCollision, NoPlan, OutsideZone, TooLow, Unreachable
from neugrasp.robot.limits import Box
from neugrasp.robot.motion import Motion, PickPlan
from neugrasp.robot.simulated_cameras import TruthCamera
from neugrasp.robot.trajectory import Pace, Trajectory, timed
from neugrasp.robot.workcell import cameras_of, planner_of, tour_of
from neugrasp.simulation.arm import JointedArm
from neugrasp.simulation.physics import World
from robot_cells import down_at
from toy_boxes import box, boxes_scene, grasp_of

pytestmark = pytest.mark.skipif(find_spec("ompl") is None, reason="needs neugrasp[robot]")

BODIES = (
    box(0.08, 0.08, "0.03 0.05 0.12"),
    box(0.22, 0.1, "0.04 0.06 0.09"),
    box(0.15, 0.22, "0.03 0.03 0.15"),
    box(0.07, 0.2, "0.05 0.05 0.05"),
)
DENSE = 0.01
"""Radians between two positions that are looked at."""
INSIDE = -0.0015
"""Metres by which bodies must overlap to count: the engine's shapes are a millimetre thicker than ours."""


@pytest.fixture(scope="module")
def seen(world: World) -> Detection:
    """The true surface of four boxes."""
    world.reset(boxes_scene(*BODIES))
    tsdf = TruthCamera(world).capture().tsdf.values
    return Detection(Grasps.of([]), world.workspace, world.gripper, tsdf)


def test_a_motion_starts_and_ends_at_rest_and_keeps_to_its_pace(cell: CellFile, motion: Motion):
    goal = cell.out_of_sight + np.array([1.0, 0.4, -0.7, 0.2, 0.9, -2.0])
    pace = Pace(joint_speed=1.0, joint_acceleration=3.0, tcp_speed=0.3)
    leg = np.linspace(cell.out_of_sight, goal, 60)
    moving = timed([leg], motion.fence.model, motion.fence.flange_from_tcp, pace)
    step = np.diff(moving.times)
    rates = np.diff(moving.joints, axis=0) / step[:, None]
    tcp = motion.tcp(moving.joints)[:, :3, 3]
    speeds = np.linalg.norm(np.diff(tcp, axis=0), axis=1) / step
    assert np.abs(rates).max() <= 1.0
    assert np.abs(np.diff(rates, axis=0) / step[1:, None]).max() <= 3.0 * 1.02
    assert 0.9 * 0.3 < speeds.max() <= 0.3
    assert np.abs(rates[[0, -1]]).max() < 0.01
    np.testing.assert_allclose(moving.joints[[0, -1]], [cell.out_of_sight, goal], atol=1e-12)


def test_a_line_is_straight_and_keeps_its_orientation(cell: CellFile, motion: Motion):
    start = motion.solutions(down_at(0.15, 0.1, 0.25), cell.out_of_sight)[0]
    goal = down_at(0.2, 0.2, 0.15)
    poses = motion.tcp(motion.line(start, goal))
    way = goal[:3, 3] - poses[0, :3, 3]
    off = np.cross(poses[:, :3, 3] - poses[0, :3, 3], way / np.linalg.norm(way))
    assert np.linalg.norm(off, axis=1).max() < 1e-9
    np.testing.assert_allclose(poses[-1], goal, atol=1e-9)
    np.testing.assert_allclose(poses[:, :3, :3], np.broadcast_to(goal[:3, :3], (len(poses), 3, 3)), atol=1e-9)


def plan(cell: CellFile, motion: Motion, grasp: Grasp, seen: Detection) -> PickPlan:
    checker = motion.checker(seen.surface(), 0.006)
    return motion.pick(cell.out_of_sight, grasp, cell.drop, checker)


@pytest.mark.slow
def test_a_grasp_is_planned_from_out_of_sight_to_the_drop(cell: CellFile, motion: Motion, seen: Detection):
    grasp = grasp_of(BODIES[1])
    found = plan(cell, motion, grasp, seen)
    np.testing.assert_allclose(found.way_in.joints[0], cell.out_of_sight)
    np.testing.assert_allclose(found.way_out.joints[-1], cell.drop)
    reached = motion.tcp(found.approach.joints[-1])
    np.testing.assert_allclose(reached[:3, 3], grasp.position, atol=1e-9)
    assert abs(reached[:3, 1] @ grasp.pose[:3, 1]) > 1 - 1e-9
    for one, after in ((found.way_in, found.approach), (found.approach, found.retreat)):
        np.testing.assert_allclose(one.joints[-1], after.joints[0], atol=1e-9)
    for one in (found.way_in, found.approach, found.retreat, found.way_out):
        motion.fence.check(one, one.joints[0])


@pytest.mark.slow
def test_the_same_question_has_the_same_answer(cell: CellFile, motion: Motion, seen: Detection):
    ways = [plan(cell, motion, grasp_of(BODIES[0]), seen).way_in.joints for _ in range(2)]
    np.testing.assert_array_equal(*ways)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pose", "error"),
    [
        (rigid(rotation_about((0, 1, 0), -np.pi / 2), (0.29, 0.29, 0.2)), Unreachable),
        (down_at(0.15, 0.15, 0.02), TooLow),
        (down_at(-0.8, 0.15, 0.2), OutsideZone),
        (down_at(0.15, 0.225, 0.08, np.pi / 4), InCollision),
    ],
    ids=["from behind", "in the table", "behind the robot", "palm in a box"],
)
def test_each_reason_not_to_grasp_is_what_it_is(
    cell: CellFile, motion: Motion, seen: Detection, pose: Array, error: type[Exception]
):
    with pytest.raises(error):
        plan(cell, motion, Grasp(pose, 0.03), seen)


@pytest.mark.slow
def test_the_arm_keeps_out_of_boxes_on_its_ways(cell: CellFile, seen: Detection):
    """A wall between the place out of sight and the table, which the free way would cross."""
    free = planner_of(cell)
    through = motion_points(free, plan(cell, free, grasp_of(BODIES[1]), seen).way_in)
    middle = through[len(through) // 2]
    wall = Box(middle - 0.03, middle + 0.03)
    walled = replace(cell, limits=replace(cell.limits, keep_out=(wall,)))
    motion = planner_of(walled)
    around = motion_points(motion, plan(walled, motion, grasp_of(BODIES[1]), seen).way_in)
    assert wall.holds(through).any()
    assert not wall.holds(around).any()


def motion_points(motion: Motion, moving: Trajectory) -> Array:
    return motion.tcp(moving.joints)[:, :3, 3]


def densely(moving: Trajectory) -> Iterator[Array]:
    for start, end in zip(moving.joints, moving.joints[1:], strict=False):
        yield from np.linspace(start, end, 1 + int(np.ceil(np.abs(end - start).max() / DENSE)))


def overlaps(world: World, arm: JointedArm, joints: Array, fingers: bool) -> list[tuple[int, int, float]]:
    """(body, link, metres) where arm or hand reach into something. The foot stands on the table."""
    arm.put(joints)
    world.detect_collisions()
    points = world._client.getContactPoints(arm.uid)
    apart = [(int(p[2]), int(p[3]), float(p[8])) for p in points if p[2] != arm.uid and p[3] > 2]
    return [p for p in apart if p[2] < INSIDE and (fingers or p[1] not in arm._fingers)]


@pytest.mark.slow
def test_the_engine_finds_nothing_in_planned_ways(
    cell: CellFile, motion: Motion, seen: Detection, world: World
):
    """Meshes of another package, in another library, between the positions that the planner looked at."""
    world.reset(boxes_scene(*BODIES))
    arm = world.mount("ur5e", cell.arm.world_from_base, cell.gripper.flange_from_hand)
    rng, planned = np.random.default_rng(0), 0
    for _ in range(12):
        body = BODIES[rng.integers(len(BODIES))]
        tilt = rotation_about((*rng.normal(size=2), 0), rng.uniform(0, 0.5))
        pose = grasp_of(body).pose.copy()
        pose[:3, :3] = tilt @ pose[:3, :3]
        try:
            found = plan(cell, motion, Grasp(pose, 0.04), seen)
        except NoPlan:
            continue
        planned += 1
        for joints in densely(found.way_in):
            assert overlaps(world, arm, joints, fingers=True) == []
        for joints in (*densely(found.approach), *densely(found.retreat)):
            assert overlaps(world, arm, joints, fingers=False) == []
    assert planned >= 4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["0.07 0.05 0.16", "0.065 0.065 0.18"])
def test_the_way_in_keeps_a_distance_from_something_tall_and_wide(
    cell: CellFile, motion: Motion, world: World, name: str
):
    """The pre-grasp itself is beside its top, 7 and 10 mm from the fingers: the way ends before."""
    body = box(0.15, 0.15, name)
    world.reset(boxes_scene(body))
    tsdf = TruthCamera(world).capture().tsdf.values
    arm = world.mount("ur5e", cell.arm.world_from_base, cell.gripper.flange_from_hand)
    uid = world._placed[0].uid
    for tilt in (0.0, 0.1):
        grasp = grasp_of(body, depth=0.04)
        grasp = replace(grasp, pose=grasp.pose @ rigid(rotation_about((0, 1, 0), tilt)))
        found = plan(cell, motion, grasp, Detection(Grasps.of([]), world.workspace, world.gripper, tsdf))
        nearest = 1.0
        for joints in densely(found.way_in):
            arm.put(joints)
            points = world._client.getClosestPoints(arm.uid, uid, 0.05)
            nearest = min(nearest, *(float(point[8]) for point in points), 1.0)
        # 6 mm are kept from a surface that a grid of 7.5 mm rounds at edges, by shapes a millimetre thinner.
        assert nearest > 0.003


@pytest.mark.slow
def test_the_tour_leads_the_camera_to_every_view_past_whatever_may_stand_there(
    cell: CellFile, motion: Motion, world: World
):
    cameras = cameras_of(cell)
    tour = tour_of(cell, motion, cameras)
    flange = motion.fence.world_from_base @ motion.fence.model.flange(
        np.stack([stop.way.joints[-1] for stop in tour.stops])
    )
    for camera, pose in zip(cameras, flange, strict=True):
        np.testing.assert_allclose(pose @ cell.camera.flange_from_camera, camera.world_from_camera, atol=1e-6)
    world.reset(boxes_scene(*(box(x, y, "0.05 0.05 0.14") for x in (0.05, 0.15, 0.25) for y in (0.05, 0.25))))
    arm = world.mount("ur5e", cell.arm.world_from_base, cell.gripper.flange_from_hand)
    for way in (*(stop.way for stop in tour.stops), tour.home):
        for joints in densely(way):
            assert overlaps(world, arm, joints, fingers=True) == []
