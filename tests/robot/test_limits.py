"""The layer below the network: what it refuses, each with its own error, and that nothing gets past it."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from neugrasp.geometry.pose import Array, apply, inverse
from neugrasp.robot.errors import (
    KeptOut,
    LimitExceeded,
    NotFinite,
    OutsideZone,
    ProtectiveStop,
    Refused,
    Stopped,
    TooFast,
    TooLow,
)
from neugrasp.robot.limits import Box, Fence, Guarded
from neugrasp.robot.trajectory import Trajectory, timed
from neugrasp.robot.workcell import planner_of
from robot_cells import PaperArm, down_at, example

CELL = example()
FENCE: Fence = planner_of(CELL).fence
HOME = CELL.out_of_sight
ELBOW = np.array([0, 0, 1.0, 0, 0, 0])


def to(goal: Array, seconds: float | None = None) -> Trajectory:
    """A straight way from out of sight, as fast as it may be, or in so many seconds."""
    motion = timed([np.linspace(HOME, goal, 50)], FENCE.model, FENCE.flange_from_tcp, FENCE.limits.pace)
    if seconds is None:
        return motion
    return Trajectory(motion.times * seconds / motion.duration, motion.joints)


def joints_for(pose: Array) -> Array:
    return planner_of(CELL).solutions(pose, HOME)[0]


def test_a_grasp_above_the_table_is_allowed():
    FENCE.check_pose(down_at(0.5, 0.0, 0.05))


@pytest.mark.parametrize(
    ("pose", "error", "words"),
    [
        (down_at(0.5, 0.0, -0.05), TooLow, "50 mm above the table"),
        (np.full((4, 4), np.nan), NotFinite, "NaN"),
        (down_at(-0.4, 0.0, 0.2), OutsideZone, "outside its zone"),
    ],
    ids=["5 cm below the table", "NaN", "behind the robot"],
)
def test_poses_that_must_not_be_are_refused_each_with_its_own_error(
    pose: Array, error: type[Refused], words: str
):
    with pytest.raises(error, match=words):
        FENCE.check_pose(pose)


@pytest.mark.parametrize(
    ("motion", "error"),
    [
        (to(joints_for(down_at(0.5, 0.0, -0.05))), TooLow),
        (to(joints_for(down_at(-0.4, 0.0, 0.3))), OutsideZone),
        (Trajectory(np.array([0.0, 1.0]), np.stack([HOME, np.full(6, np.nan)])), NotFinite),
        (to(HOME + np.array([0.8, 0, 0, 0, 0, 0]), seconds=0.2), TooFast),
        (Trajectory(np.array([0.0, 1.0, 1.0]), np.stack([HOME] * 3)), TooFast),
        (Trajectory(np.array([0.0, 20.0]), np.stack([HOME, HOME + 3.0 * ELBOW])), LimitExceeded),
        (Trajectory(np.array([0.0, 1.0]), np.stack([HOME + 0.1] * 2)), LimitExceeded),
    ],
    ids=["below", "behind", "NaN", "2 m/s", "no time", "out of range", "starts elsewhere"],
)
def test_motions_that_must_not_be_never_reach_the_arm(motion: Trajectory, error: type[Refused]):
    arm = PaperArm(HOME)
    with pytest.raises(error):
        Guarded(arm, FENCE).execute(motion, until_contact=False, timeout_s=60)
    assert arm.done == []


def test_a_command_of_two_metres_a_second_says_how_fast_it_was():
    motion = to(HOME + np.array([0.4, 0, 0, 0, 0, 0]))
    tcp = (FENCE.model.flange(motion.joints) @ FENCE.flange_from_tcp)[:, :3, 3]
    fastest = np.linalg.norm(np.diff(tcp, axis=0), axis=1) / np.diff(motion.times)
    quick = Trajectory(motion.times * fastest.max() / 2.0, motion.joints)
    loose = replace(FENCE.limits.pace, joint_speed=100.0, joint_acceleration=1e6)
    fence = replace(FENCE, limits=replace(FENCE.limits, pace=loose))
    with pytest.raises(TooFast, match=r"TCP would move at 2\.00 m/s; 0\.5 allowed"):
        fence.check(quick, HOME)


def test_no_part_of_the_arm_enters_a_box_that_it_is_kept_out_of():
    forearm = FENCE.model.frames(HOME)[3, :3, 3]
    box = Box(forearm - 0.05, forearm + 0.05)
    fence = replace(FENCE, limits=replace(FENCE.limits, keep_out=(box,)))
    with pytest.raises(KeptOut, match="keep-out box 0"):
        fence.check(to(HOME + 0.05), HOME)
    FENCE.check(to(HOME + 0.05), HOME)


joints_near_home = arrays(np.float64, (6,), elements=st.floats(-1.5, 1.5)).map(lambda x: HOME + x)
wild = arrays(np.float64, (6,), elements=st.floats(allow_nan=True, allow_infinity=True))


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(
    corners=st.lists(st.one_of(joints_near_home, joints_near_home, wild), min_size=1, max_size=4),
    seconds=st.floats(0.001, 30),
)
def test_nothing_that_reaches_the_arm_leaves_the_limits(corners: list[Array], seconds: float):
    """Whatever is asked for; the limits are looked at here in their own words, not in the fence's."""
    with np.errstate(all="ignore"):
        path = np.concatenate(
            [np.linspace(a, b, 40) for a, b in zip([HOME, *corners], corners, strict=False)]
        )
    motion = Trajectory(np.linspace(0, seconds, len(path)), path)
    arm = PaperArm(HOME)
    try:
        Guarded(arm, FENCE).execute(motion, until_contact=False, timeout_s=60)
    except Refused:
        assert arm.done == []
        return
    (done,) = arm.done
    limits = CELL.limits
    assert np.isfinite(done.joints).all()
    assert (np.abs(done.joints) <= np.array(FENCE.model.high) + 1e-9).all()
    rates = np.diff(done.joints, axis=0) / np.diff(done.times)[:, None]
    assert np.abs(rates).max() <= 1.03 * limits.pace.joint_speed
    tcp = FENCE.world_from_base @ FENCE.model.flange(done.joints) @ FENCE.flange_from_tcp
    speeds = np.linalg.norm(np.diff(tcp[:, :3, 3], axis=0), axis=1) / np.diff(done.times)
    assert speeds.max() <= 1.03 * limits.pace.tcp_speed
    heights = apply(inverse(FENCE.world_from_table), tcp[:, :3, 3])[:, 2]
    assert heights.min() >= limits.lowest_tcp - 1e-6
    assert limits.zone.holds(tcp[:, :3, 3]).all()


class Failing(PaperArm):
    """Stops itself at the second motion."""

    def execute(self, motion: Trajectory, until_contact: bool, timeout_s: float) -> bool:
        if self.done:
            raise ProtectiveStop("the controller felt a force")
        return super().execute(motion, until_contact, timeout_s)


def test_after_a_fault_nothing_moves():
    arm = Failing(HOME)
    guarded = Guarded(arm, FENCE)
    there = to(HOME + 0.1)
    guarded.execute(there, until_contact=False, timeout_s=60)
    back = Trajectory(there.times, there.joints[::-1])
    for _ in range(3):
        with pytest.raises(ProtectiveStop, match="felt a force"):
            guarded.execute(back, until_contact=False, timeout_s=60)
    assert len(arm.done) == 1
    assert arm.stops == 1


def test_a_stop_from_another_thread_is_the_last_word_and_leaving_stops_too():
    arm = PaperArm(HOME)
    with Guarded(arm, FENCE) as guarded:
        thread = threading.Thread(target=guarded.stop)
        thread.start()
        thread.join()
        with pytest.raises(Stopped):
            guarded.execute(to(HOME + 0.1), until_contact=False, timeout_s=60)
    assert arm.done == []
    assert arm.stops == 2
