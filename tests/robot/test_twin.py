"""The twin: an arm in physics that clears boxes, fails where an arm fails, and stops when it is told."""

from __future__ import annotations

import threading
from dataclasses import replace
from functools import partial
from importlib.util import find_spec

import numpy as np
import pytest

from neugrasp.detection.contract import Detection
from neugrasp.evaluation.declutter import EpisodeConfig, declutter
from neugrasp.evaluation.ground_truth import SimulatedGroundTruth
from neugrasp.evaluation.protocols import protocol_of, strategy_of
from neugrasp.geometry.pose import rotation_about
from neugrasp.grasp import Grasp, Grasps
from neugrasp.robot.cell_file import CellFile
from neugrasp.robot.errors import (
    ConnectionLost,
    EmergencyStop,
    ForceLimit,
    MotionTimeout,
    ProtectiveStop,
    RobotError,
    Stopped,
    TooLow,
)
from neugrasp.robot.interface import Robot
from neugrasp.robot.motion import Motion
from neugrasp.robot.pick import DROPPED, SUCCESS, pick
from neugrasp.robot.ranking import first_possible
from neugrasp.robot.simulated_cameras import Truth, TruthCamera
from neugrasp.robot.tour import TouringCamera
from neugrasp.robot.trajectory import Trajectory
from neugrasp.robot.twin import TwinArm, TwinRobot
from neugrasp.robot.workcell import cameras_of, planner_of, tour_of
from neugrasp.simulation.arm import JointedArm
from neugrasp.simulation.physics import World
from robot_cells import down_at
from toy_boxes import box, boxes_scene, grasp_of

pytestmark = pytest.mark.skipif(find_spec("ompl") is None, reason="needs neugrasp[robot]")

UP = np.array([0.0, 0.0, 1.0])
TWIN_SEEDS = 25
BODIES = (box(0.08, 0.1), box(0.22, 0.1), box(0.15, 0.22))


class Knowing:
    """Grasps every box from above, on the true surface."""

    def __init__(self, world: World):
        self.world = world

    def detect(self, truth: Truth) -> Detection:
        grasps = Grasps.of([grasp_of(body) for body in self.world.bodies()])
        return Detection(grasps, truth.workspace, self.world.gripper, truth.tsdf.values)


@pytest.mark.slow
def test_the_arm_looks_picks_and_drops_until_the_table_is_empty(world: World, cell: CellFile, motion: Motion):
    twin = TwinRobot(world, boxes_scene(*BODIES), cell, motion)
    truth = TruthCamera(world)
    camera = TouringCamera(twin.arm, tour_of(cell, motion, cameras_of(cell)), truth)
    game = EpisodeConfig(
        protocol_of("paper"), strategy_of("top"), lambda i, j: np.random.default_rng([i, j]), UP
    )
    robot = Robot(camera, twin.manipulator, twin.table)
    episode = declutter(game, 0, robot, Knowing(world), SimulatedGroundTruth(twin.table, truth, judges=False))
    assert episode.ending == "table empty"
    assert [(a.objects, a.reason) for a in episode.attempts] == [(3, SUCCESS), (2, SUCCESS), (1, SUCCESS)]
    np.testing.assert_allclose(twin.arm.state().joints, cell.out_of_sight, atol=1e-3)


def test_the_arm_is_not_seen(world: World, cell: CellFile, motion: Motion):
    camera = cameras_of(cell)[0]
    world.reset(boxes_scene(*BODIES))
    without = world.depth_and_mask(camera)
    TwinRobot(world, boxes_scene(*BODIES), cell, motion)
    for before, after in zip(without, world.depth_and_mask(camera), strict=True):
        np.testing.assert_array_equal(before, after)


def seen(world: World, *grasps: Grasp) -> Detection:
    truth = TruthCamera(world).capture()
    return Detection(Grasps.of(grasps), truth.workspace, world.gripper, truth.tsdf.values)


@pytest.mark.slow
def test_grasps_are_tried_in_their_order_until_one_can_be_reached(
    world: World, cell: CellFile, motion: Motion
):
    tall = box(0.15, 0.22, "0.03 0.05 0.13")
    twin = TwinRobot(world, boxes_scene(*BODIES[:2], tall), cell, motion)
    sideways = down_at(0.29, 0.29, 0.2)
    sideways[:3, :3] = rotation_about((0, 1, 0), -np.pi / 2)
    ranked = seen(
        world,
        Grasp(down_at(0.15, 0.15, 0.0), 0.03, 0.99),
        Grasp(sideways, 0.03, 0.98),
        replace(grasp_of(tall, depth=0.11), score=0.97),
        grasp_of(BODIES[1]),
    )
    before = twin.arm.state().joints
    chosen = first_possible(twin.manipulator, ranked, lambda grasps: 0)
    assert chosen.index == 3
    reasons = [one.reason for one in chosen.skipped]
    assert reasons == ["outside the limits", "unreachable", "collision"]
    assert chosen.counts == {"outside the limits": 1, "unreachable": 1, "collision": 1}
    np.testing.assert_allclose(twin.arm.state().joints, before, atol=1e-6)
    assert chosen.hand is not None
    assert pick(twin.manipulator, chosen.hand, ranked.grasps[3], 0.004, UP).reason == SUCCESS


@pytest.mark.slow
def test_where_none_can_be_reached_nothing_moves(world: World, cell: CellFile, motion: Motion):
    twin = TwinRobot(world, boxes_scene(*BODIES), cell, motion)
    below = seen(world, Grasp(down_at(0.15, 0.15, -0.05), 0.03))
    chosen = first_possible(twin.manipulator, below, lambda grasps: 0)
    assert (chosen.index, chosen.hand) == (None, None)
    assert "-100 mm above the table" in chosen.skipped[0].details


@pytest.mark.slow
def test_an_object_that_slips_on_the_way_is_not_a_success(world: World, cell: CellFile, motion: Motion):
    twin = TwinRobot(world, boxes_scene(BODIES[1]), cell, motion)
    hand = twin.manipulator.prepare(grasp_of(BODIES[1]), seen(world))
    hand.holds = iter((True, False)).__next__  # type: ignore[method-assign]
    assert pick(twin.manipulator, hand, grasp_of(BODIES[1]), 0.004, UP).reason == DROPPED


def test_a_contact_on_the_way_ends_the_pick_with_the_arm_out_of_sight(
    world: World, cell: CellFile, motion: Motion
):
    """A box that nobody saw stands where the hand comes down."""
    twin = TwinRobot(world, boxes_scene(box(0.22, 0.1, "0.06 0.06 0.22")), cell, motion)
    nowhere = np.ones((40, 40, 40), dtype=np.float32)
    unseen = Detection(Grasps.of([]), world.workspace, world.gripper, nowhere)
    grasp = Grasp(down_at(0.22, 0.1, 0.1), 0.03)
    result = pick(twin.manipulator, twin.manipulator.prepare(grasp, unseen), grasp, 0.004, UP)
    assert result.touched
    assert not result.success
    np.testing.assert_allclose(twin.arm.state().joints, cell.out_of_sight, atol=1e-3)


def test_a_stop_from_another_thread_ends_the_motion_under_way(world: World, cell: CellFile, motion: Motion):
    twin = TwinRobot(world, boxes_scene(), cell, motion)
    far = motion.way(cell.out_of_sight, cell.drop[None], motion.checker(None))
    far = replace(far, times=far.times / 0.01)
    timer = threading.Timer(0.3, twin.arm.stop)
    timer.start()
    with pytest.raises(Stopped):
        twin.arm.execute(far, until_contact=False, timeout_s=1e4)
    stopped = twin.arm.state().joints
    assert np.abs(stopped - cell.drop).max() > 0.05
    with pytest.raises(Stopped):
        twin.arm.execute(far, until_contact=False, timeout_s=1e4)
    np.testing.assert_array_equal(twin.arm.state().joints, stopped)


def test_a_motion_that_takes_too_long_is_not_begun(world: World, cell: CellFile, motion: Motion):
    TwinRobot(world, boxes_scene(), cell, motion)
    assert world._arm is not None
    arm = TwinArm(world._arm)
    way = Trajectory(np.array([0.0, 10.0]), np.stack([cell.out_of_sight] * 2))
    with pytest.raises(MotionTimeout, match=r"takes 10\.0 s; 5\.0 s allowed"):
        arm.execute(way, until_contact=False, timeout_s=5)


def test_slower_is_the_same_way_in_more_time(cell: CellFile, motion: Motion):
    slow = planner_of(cell.at_speed(0.5))
    ways = [m.way(cell.out_of_sight, cell.drop[None], m.checker(None)) for m in (motion, slow)]
    assert ways[1].duration == pytest.approx(2 * ways[0].duration, rel=0.05)
    with pytest.raises(TooLow):
        replace(slow.fence).check_pose(down_at(0.15, 0.15, 0.05))


class FailingArm(TwinArm):
    """Breaks down in the middle of one of its motions, and counts what it is told to do afterwards."""

    def __init__(self, body: JointedArm, fault: RobotError, number: int):
        super().__init__(body)
        self.fault, self.left, self.told_after = fault, number, 0

    def execute(self, motion: Trajectory, until_contact: bool, timeout_s: float) -> bool:
        self.left -= 1
        if self.left > 0:
            return super().execute(motion, until_contact, timeout_s)
        self.told_after += self.left < 0
        half = motion.times <= motion.times[0] + motion.duration / 2
        half[:2] = True
        super().execute(Trajectory(motion.times[half], motion.joints[half]), until_contact, timeout_s)
        raise self.fault


def made_failing(made: list[FailingArm], fault: RobotError, number: int, body: JointedArm) -> FailingArm:
    made.append(FailingArm(body, fault, number))
    return made[-1]


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_rounds_with_a_fault_end_with_it_and_nothing_moves_afterwards(
    world: World, cell: CellFile, motion: Motion, monkeypatch: pytest.MonkeyPatch
):
    """At any motion of a round: to a view, to a grasp, back, to the drop."""
    kinds = (ProtectiveStop, EmergencyStop, ConnectionLost, MotionTimeout, ForceLimit)
    for seed in range(TWIN_SEEDS):
        rng = np.random.default_rng(seed)
        fault = kinds[seed % len(kinds)](f"seed {seed}")
        number = int(rng.integers(1, 14))
        made: list[FailingArm] = []
        maker = partial(made_failing, made, fault, number)
        monkeypatch.setattr("neugrasp.robot.twin.TwinArm", maker)
        twin = TwinRobot(world, boxes_scene(*BODIES[:2]), cell, motion)
        truth = TruthCamera(world)
        camera = TouringCamera(twin.arm, tour_of(cell, motion, cameras_of(cell)), truth)
        config = EpisodeConfig(
            protocol_of("paper"), strategy_of("top"), lambda i, j: np.random.default_rng([i, j]), UP
        )
        robot = Robot(camera, twin.manipulator, twin.table)
        ground = SimulatedGroundTruth(twin.table, truth, judges=False)
        with pytest.raises(type(fault)) as told:
            declutter(config, 0, robot, Knowing(world), ground)
        assert told.value is fault
        stopped = twin.arm.state().joints
        still = Trajectory(np.array([0.0, 1.0]), np.stack([stopped, stopped]))
        with pytest.raises(type(fault)):
            twin.arm.execute(still, until_contact=False, timeout_s=5)
        assert made[0].told_after == 0
        np.testing.assert_allclose(twin.arm.state().joints, stopped, atol=1e-4)
