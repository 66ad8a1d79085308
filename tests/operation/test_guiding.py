"""Grasps to which a person leads the arm come back exactly, with what came of them."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fake_hardware import FakeUr
from neugrasp.data.captures import read_capture
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, from_quaternion, inverse
from neugrasp.observation import View, Views
from neugrasp.operation.collect import collect
from neugrasp.operation.command import Collect
from neugrasp.operation.guiding import LIFT, Guide, lead_through
from neugrasp.operation.hardware import Hardware
from neugrasp.operation.person import Person
from neugrasp.robot.errors import RobotError, Stopped
from neugrasp.robot.limits import Guarded
from neugrasp.robot.ur_arm import UrArm
from neugrasp.robot.workcell import cameras_of, planner_of
from robot_cells import TWIN, PaperArm, down_at, example

pytestmark = pytest.mark.skipif(find_spec("ompl") is None, reason="needs neugrasp[robot]")


@dataclass
class LedArm(PaperArm):
    """An arm that a person can lead."""

    is_free: bool = False

    def release(self) -> None:
        self.is_free = True

    def hold(self) -> None:
        self.is_free = False

    def execute(self, *motion: Any) -> bool:
        assert not self.is_free
        return super().execute(*motion)


@dataclass
class Fingers:
    """Stop at an object; drop it when the arm lifts, where it slips."""

    thing: float | None = None
    slips: bool = False
    at: float = 0.085
    arm: LedArm | None = None
    max_opening: float = 0.085

    def move(self, opening: float, force: float, timeout_s: float) -> float:
        self.at = self.thing if opening == 0.0 and self.thing is not None else opening
        self.closed_after = len(self.arm.done) if self.arm else 0
        return self.at

    def opening(self) -> float:
        return 0.0 if self._has_lost() else self.at

    def holds(self) -> bool:
        return 0 < self.opening() < self.max_opening

    def _has_lost(self) -> bool:
        assert self.arm is not None
        return self.slips and self.at < self.max_opening and len(self.arm.done) > self.closed_after


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@dataclass
class Script:
    """What a person does, one thing for each question: answers after a deed of theirs."""

    deeds: list[Callable[[], str]]
    told: Terminal = field(default_factory=Terminal)

    def isatty(self) -> bool:
        return True

    def readline(self) -> str:
        return self.deeds.pop(0)() + "\n" if self.deeds else ""


class Pencil:
    def capture(self) -> Views:
        cell = example()
        photo = np.random.default_rng(0).integers(80, 160, (360, 640, 3), dtype=np.uint8)
        return Views(tuple(View(camera, photo, photo) for camera in cameras_of(cell)), cell.workspace)


@dataclass
class Led:
    """A cell with an arm to lead, and the poses that it is led to."""

    arm: LedArm
    fingers: Fingers
    guide: Guide
    script: Script

    def at(self, pose: Array, thing: float | None = None, slips: bool = False) -> Callable[[], str]:
        """Leads the hand to a pose, where a thing may lie, and presses Enter."""

        def lead() -> str:
            assert self.arm.is_free
            self.arm.joints = self.guide.hardware.motion.solutions(pose, self.arm.joints)[0]
            self.fingers.thing, self.fingers.slips = thing, slips
            return ""

        return lead

    def done(self) -> str:
        self.arm.joints = self.guide.cell.out_of_sight + 0.1
        return "d"


@pytest.fixture
def led() -> Led:
    cell = example()
    motion = planner_of(cell)
    arm, script = LedArm(cell.out_of_sight), Script([])
    fingers = Fingers(arm=arm)
    camera: Any = None
    hand: Any = None
    guarded = Guarded(arm, motion.fence)
    hardware = Hardware(guarded, hand, camera, fingers, motion, guarded)
    asked: Any = script
    return Led(
        arm,
        fingers,
        Guide(cell, hardware, Pencil(), Person("a hand must be led", asked, script.told)),
        script,
    )


def enter() -> str:
    return ""


@pytest.mark.slow
def test_poses_widths_and_outcomes_come_back_exactly(led: Led, tmp_path: Path):
    poses = [down_at(0.5, 0.05, 0.05, 0.4), down_at(0.45, -0.05, 0.03, -0.9), down_at(0.55, 0.0, 0.04)]
    led.script.deeds = [
        enter,
        led.at(poses[0], thing=0.042),
        led.at(poses[1]),
        led.at(poses[2], thing=0.03, slips=True),
        led.done,
    ]
    lead_through({0: tmp_path / "0"}, led.guide)
    scene, gripper = read_capture(tmp_path / "0"), led.guide.cell.gripper.gripper
    labels = scene.labels
    assert labels.success.tolist() == [True, False, False]
    np.testing.assert_allclose(labels.widths, [0.042, 0.085, 0.085], atol=1e-6)
    world_from_cube = led.guide.cell.workspace.world_from_workspace
    for i, pose in enumerate(poses):
        stored = from_quaternion(labels.quaternions[i], labels.points[i])
        expected = inverse(world_from_cube) @ pose
        np.testing.assert_allclose(stored[:3, :3], expected[:3, :3], atol=1e-6)
        tcp = stored[:3, 3] + gripper.tcp_depth * stored[:3, 2]
        np.testing.assert_allclose(tcp, expected[:3, 3], atol=1e-6)


@pytest.mark.slow
def test_the_arm_lifts_straight_up_and_puts_it_back_and_ends_out_of_sight(led: Led, tmp_path: Path):
    pose, motion = down_at(0.5, 0.05, 0.05), led.guide.hardware.motion
    led.script.deeds = [enter, led.at(pose, thing=0.04), led.done]
    lead_through({0: tmp_path / "0"}, led.guide)
    lift, back, home = led.arm.done
    heights = motion.tcp(lift.joints)[:, :3, 3]
    np.testing.assert_allclose(heights[:, :2], np.tile(pose[:2, 3], (len(heights), 1)), atol=1e-3)
    assert heights[-1, 2] - heights[0, 2] == pytest.approx(LIFT, abs=1e-4)
    np.testing.assert_allclose(back.joints[-1], lift.joints[0], atol=1e-9)
    np.testing.assert_allclose(home.joints[-1], led.guide.cell.out_of_sight, atol=1e-9)


@pytest.mark.slow
def test_a_place_where_the_hand_must_not_be_is_said_and_not_stored(led: Led, tmp_path: Path):
    led.script.deeds = [
        enter,
        led.at(down_at(0.5, 0.0, -0.01), thing=0.04),
        led.at(down_at(0.5, 0.0, 0.05), thing=0.04),
        led.done,
    ]
    lead_through({0: tmp_path / "0"}, led.guide)
    assert "not from here: the TCP would be -10 mm above the table" in led.script.told.getvalue()
    assert len(read_capture(tmp_path / "0").labels.success) == 1


@pytest.mark.slow
def test_whoever_ends_it_keeps_what_was_tried(led: Led, tmp_path: Path):
    led.script.deeds = [enter, led.at(down_at(0.5, 0.0, 0.05), thing=0.04), lambda: "q"]
    with pytest.raises(Stopped, match="the same command goes on"):
        lead_through({0: tmp_path / "0", 1: tmp_path / "1"}, led.guide)
    assert read_capture(tmp_path / "0").labels.success.tolist() == [True]
    assert not led.arm.is_free
    assert not (tmp_path / "1").exists()


@pytest.mark.slow
def test_an_arm_that_cannot_be_led_says_so(led: Led, tmp_path: Path):
    stiff = Guarded(PaperArm(led.guide.cell.out_of_sight), led.guide.hardware.motion.fence)
    guide = replace(led.guide, hardware=replace(led.guide.hardware, led=stiff))
    led.script.deeds = [enter]
    with pytest.raises(RobotError, match="cannot be led by hand"):
        lead_through({0: tmp_path / "0"}, guide)


def test_nobody_at_the_terminal_and_a_twin_are_refused(tmp_path: Path):
    with pytest.raises(InputError, match="run this in a terminal"):
        Person("run this in a terminal", io.StringIO(), io.StringIO())
    with pytest.raises(InputError, match="give the file of a real cell"):
        collect(Collect(out=tmp_path / "out", cell=TWIN, by_hand=True))


@pytest.mark.slow
@pytest.mark.skipif(find_spec("rtde_control") is None, reason="needs neugrasp[robot]")
def test_the_driver_lets_go_reads_where_it_was_led_and_holds():
    ur = FakeUr()
    try:
        with UrArm(ur.address, 100.0) as arm:
            arm.release()
            joints = [1.1, -1.2, 1.3, -1.4, -1.5, 0.6]
            ur.fault("led " + " ".join(map(str, joints)))
            arm.hold()
            np.testing.assert_array_equal(arm.state().joints, joints)
    finally:
        ur.close()
