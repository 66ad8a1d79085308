"""The driver of UR arms against a controller of ours in another process, with faults.

The client is the real one; the controller (tests/fake_ur.py) speaks the published protocols and has no
physics. Nothing here was tried on an arm.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np
import pytest

from fake_hardware import FakeUr
from neugrasp.robot.errors import (
    ConnectionLost,
    EmergencyStop,
    ForceLimit,
    ProtectiveStop,
    RobotError,
    Stopped,
)
from neugrasp.robot.limits import Guarded
from neugrasp.robot.trajectory import Trajectory
from neugrasp.robot.ur_arm import UrArm
from neugrasp.robot.workcell import planner_of
from robot_cells import example

pytestmark = pytest.mark.skipif(find_spec("rtde_control") is None, reason="needs neugrasp[robot]")

CELL = example()
HOME = CELL.out_of_sight


@pytest.fixture
def fake() -> Iterator[FakeUr]:
    fake = FakeUr()
    yield fake
    fake.close()


def motion(seconds: float) -> Trajectory:
    """A slow turn of the last joint by a quarter of a radian."""
    s = np.linspace(0, 1, 101)
    turn = np.outer(s**3 * (10 - 15 * s + 6 * s * s), [0, 0, 0, 0, 0, 0.25])
    return Trajectory(seconds * s, HOME + turn)


@pytest.mark.slow
def test_a_motion_arrives_as_it_was_planned(fake: FakeUr):
    with UrArm(fake.address, 100.0) as arm:
        np.testing.assert_allclose(arm.state().joints, HOME, atol=1e-5)
        assert arm.execute(motion(0.5), until_contact=True, timeout_s=5) is False
        np.testing.assert_allclose(arm.state().joints, motion(0.5).joints[-1], atol=1e-5)
    sent = [line.split() for line in fake.said() if line.startswith("servo")]
    targets = np.array([[float(x) for x in words[2:]] for words in sent])
    assert 50 <= len(targets) <= 70
    assert (np.diff(targets[:, 5]) >= -1e-9).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("word", "error"),
    [
        ("push", ForceLimit),
        ("protective", ProtectiveStop),
        ("emergency", EmergencyStop),
        ("silent", ConnectionLost),
        ("drop", ConnectionLost),
    ],
)
def test_a_fault_ends_the_motion_and_nothing_moves_afterwards(
    fake: FakeUr, word: str, error: type[RobotError]
):
    """Each within four seconds, on a busy machine; where the library crashes or waits over it, too."""
    told: list[float] = []

    def disturb() -> None:
        time.sleep(0.5)
        told.append(time.monotonic())
        fake.fault(word)

    with UrArm(fake.address, 100.0) as arm:
        guarded = Guarded(arm, planner_of(CELL).fence)
        threading.Thread(target=disturb).start()
        with pytest.raises(error):
            guarded.execute(motion(20), until_contact=False, timeout_s=60)
        assert time.monotonic() - told[0] < 4
        time.sleep(0.2)
        fake.said()
        with pytest.raises(error):
            guarded.execute(motion(20), until_contact=False, timeout_s=60)
        assert not [line for line in fake.said() if line.startswith("servo")]


@pytest.mark.slow
def test_a_stop_from_another_thread_ends_the_motion(fake: FakeUr):
    with UrArm(fake.address, 100.0) as arm:
        timer = threading.Timer(0.3, arm.stop)
        timer.start()
        began = time.monotonic()
        with pytest.raises(Stopped):
            arm.execute(motion(20), until_contact=False, timeout_s=60)
        assert time.monotonic() - began < 2
        timer.join()
        assert any(line.startswith("stop") for line in fake.said())


@pytest.mark.slow
def test_where_there_is_no_controller_that_is_said():
    with pytest.raises(ConnectionLost, match=r"127\.0\.1\.9: no UR controller that takes commands"):
        UrArm("127.0.1.9", 100.0)


@pytest.mark.slow
def test_a_contact_is_no_excess_of_force(fake: FakeUr):
    """The stand-in presses with 120 N: a contact where 200 N are allowed."""
    with UrArm(fake.address, 200.0) as arm:
        timer = threading.Timer(0.3, fake.fault, args=["push"])
        timer.start()
        assert arm.execute(motion(20), until_contact=True, timeout_s=60) is True
        timer.join()
