"""A dry run: every motion of a round, with nothing connected; and a person who is asked before each."""

from __future__ import annotations

import io
import json
import os
import pty
import threading
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from neugrasp.data.scene_folder import write_scene
from neugrasp.detection.contract import Detection
from neugrasp.detection.registry import PHOTOS, DetectorSpec
from neugrasp.errors import InputError
from neugrasp.grasp import Grasp, Grasps
from neugrasp.observation import View, Views
from neugrasp.operation import run
from neugrasp.operation.command import Run
from neugrasp.operation.confirm import Confirming
from neugrasp.robot.arm_hand import ArmHand, Places
from neugrasp.robot.attended import AttendedArm, AttendedGripper, AttendedManipulator, Step
from neugrasp.robot.cell_file import read_cell
from neugrasp.robot.errors import LeftOut, Stopped
from neugrasp.robot.limits import Guarded
from neugrasp.robot.pick import SUCCESS, pick
from neugrasp.robot.ranking import first_possible
from neugrasp.robot.rehearsal import _PaperGripper
from neugrasp.robot.workcell import cameras_of, planner_of
from robot_cells import TWIN, PaperArm, down_at, example

pytestmark = pytest.mark.skipif(find_spec("ompl") is None, reason="needs neugrasp[robot]")

CELL = example()
GRASPS = (Grasp(down_at(0.5, 0.02, 0.06), 0.03, 0.9), Grasp(down_at(0.45, -0.05, 0.06), 0.04, 0.8))


class Pointing:
    """Always the same grasps, and one below the table before them."""

    def detect(self, seen: Views) -> Detection:
        below = Grasp(down_at(0.5, 0.0, -0.05), 0.03, 0.95)
        return Detection(Grasps.of([below, *GRASPS]), seen.workspace, CELL.gripper.gripper)


@pytest.fixture
def hardware(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cell file whose addresses nobody answers at."""
    text = TWIN.read_text().split("# What lies on")[0]
    for part, driver in (("arm", "ur"), ("gripper", "robotiq")):
        text = text.replace(f'[{part}]\ndriver = "twin"', f'[{part}]\ndriver = "{driver}"\naddress = "x"')
    path = tmp_path / "cell.toml"
    path.write_text(text.replace('[camera]\ndriver = "twin"', '[camera]\ndriver = "realsense"'))

    def nobody(*_: object, **__: object) -> None:
        raise AssertionError("a dry run connects to nothing")

    for name in ("UrArm", "Robotiq", "RealSense"):
        monkeypatch.setattr(f"neugrasp.operation.hardware.{name}", nobody)
    spec = DetectorSpec(PHOTOS, lambda options: Pointing())
    monkeypatch.setattr(run, "detector_spec", lambda name: spec)
    return path


def photos(folder: Path) -> Path:
    """A capture of the cell."""
    blank = np.full((360, 640, 3), 90, dtype=np.uint8)
    views = tuple(View(camera, blank, blank, name=f"{i}") for i, camera in enumerate(cameras_of(CELL)))
    write_scene(folder, Views(views, CELL.workspace))
    return folder


@pytest.mark.slow
def test_every_motion_is_told_and_drawn_and_nothing_is_connected(hardware: Path, tmp_path: Path):
    said = run.run(
        Run(hardware, tmp_path / "run", dry_run=True, photos=photos(tmp_path / "scene"), speed=0.5)
    )
    assert "nothing was sent to arm or gripper" in said
    assert "passed over: outside the limits (the TCP would be -51 mm above the table" in said
    assert "TCP (+0.500, +0.020, +0.060) m" in said
    steps = json.loads((tmp_path / "run/dry_run/motions.json").read_text())
    names = ["to view 0", "to view 1", "to view 2", "to view 3", "out of sight", "gripper opens"]
    names += ["to the pre-grasp", "straight to the grasp", "gripper closes", "straight back from the grasp"]
    assert [step["what"] for step in steps] == [*names, "to the drop place", "gripper opens", "out of sight"]
    assert not (tmp_path / "run/run.json").exists()
    assert (tmp_path / "run/dry_run/motions.png").stat().st_size > 10_000
    cell = read_cell(hardware).at_speed(0.5)
    here = cell.out_of_sight
    for step in (step for step in steps if "joints" in step):
        joints = np.array(step["joints"])
        np.testing.assert_allclose(joints[0], here, atol=1e-9)
        here = joints[-1]
        assert step["tcp_speed"] <= cell.limits.pace.tcp_speed * 1.001
        assert step["joint_speed"] <= cell.limits.pace.joint_speed * 1.001
        poses = planner_of(cell).tcp(joints)
        np.testing.assert_allclose(step["tcp_position"], poses[:, :3, 3], atol=1e-9)
    grasped = next(step for step in steps if step["what"] == "straight to the grasp")
    deeper = cell.gripper.gripper.tip_setback(GRASPS[0].width) * GRASPS[0].approach
    np.testing.assert_allclose(grasped["tcp_position"][-1], GRASPS[0].position + deeper, atol=1e-6)
    assert grasped["tcp_speed"] <= cell.approach_speed * 1.001


@pytest.mark.slow
def test_without_photos_of_this_cell_there_is_no_dry_run(hardware: Path, tmp_path: Path):
    config = Run(hardware, tmp_path / "run", dry_run=True)
    with pytest.raises(InputError, match="it needs photos: neugrasp capture"):
        run.run(config)
    elsewhere = replace(CELL, workspace=replace(CELL.workspace, world_from_workspace=np.eye(4)))
    black = np.zeros((360, 640, 3), np.uint8)
    views = tuple(View(camera, black, black, name="") for camera in cameras_of(elsewhere))
    write_scene(tmp_path / "other", Views(views, elsewhere.workspace))
    with pytest.raises(InputError, match="its cube is not where"):
        run.run(replace(config, photos=tmp_path / "other"))
    with pytest.raises(InputError, match="nothing to --confirm or --view"):
        run.run(replace(config, confirm=True))
    with pytest.raises(InputError, match="--photos is for --dry-run"):
        run.run(Run(hardware, tmp_path / "run", photos=tmp_path / "scene"))


@pytest.mark.slow
def test_a_twin_is_rehearsed_with_its_own_table(tmp_path: Path):
    said = run.run(Run(TWIN, tmp_path / "run", detector="oracle", dry_run=True))
    assert "to view 3" in said
    assert "straight to the grasp" in said
    assert not (tmp_path / "run/rounds").exists()


class Person:
    """At the other end of a pseudo-terminal: gives one answer to each question."""

    def __init__(self, *answers: str):
        self.ours, theirs = pty.openpty()
        self.asked = os.fdopen(os.dup(theirs), "r")
        self.told = os.fdopen(theirs, "w")
        self.answers, self.heard = iter(answers), ""
        self.thread = threading.Thread(target=self._answer, daemon=True)
        self.thread.start()

    def _answer(self) -> None:
        questions = 0
        while True:
            try:
                self.heard += os.read(self.ours, 4096).decode()
            except OSError:
                return
            while self.heard.count("q: quit]") > questions:
                questions += 1
                os.write(self.ours, (next(self.answers, "q") + "\n").encode())

    def close(self) -> None:
        self.asked.close()
        self.told.close()
        self.thread.join(10)
        os.close(self.ours)


def played(*answers: str) -> tuple[str, PaperArm, str]:
    """A grasp carried out on paper while a person answers: what came of it, the arm, and what was said."""
    person, arm, motion = Person(*answers), PaperArm(CELL.out_of_sight.copy()), planner_of(CELL)
    attendant = Confirming(motion, person.asked, person.told)
    attended = AttendedArm(Guarded(arm, motion.fence), attendant)
    fingers = AttendedGripper(_PaperGripper(0.085, 0.03), attendant)
    places = Places(CELL.out_of_sight, CELL.drop, 20.0)
    hand = AttendedManipulator(ArmHand(attended, fingers, motion, places, lambda: None), attendant)
    detection = Detection(Grasps.of(GRASPS), CELL.workspace, CELL.gripper.gripper)
    try:
        chosen = first_possible(hand, detection, lambda grasps: 0)
        assert chosen.index is not None
        assert chosen.hand is not None
        up = np.array([0.0, 0.0, 1.0])
        ending = pick(hand, chosen.hand, detection.grasps[chosen.index], 0.004, up).reason
        return f"{ending} {chosen.index}", arm, person.heard
    except Stopped as error:
        return str(error), arm, person.heard
    finally:
        person.close()


def test_enter_goes_on_and_every_motion_is_announced():
    ending, arm, heard = played(*[""] * 9)
    assert ending == f"{SUCCESS} 0"
    assert len(arm.done) == 5
    for words in (
        "a grasp of score 0.90",
        "gripper opens",
        "to the pre-grasp",
        "straight back",
        "out of sight",
    ):
        assert f"next: {words}" in heard


def test_a_grasp_that_is_left_out_gives_way_to_the_next():
    assert played("s", *[""] * 9)[0] == f"{SUCCESS} 1"


def test_a_grasp_left_out_on_the_way_ends_out_of_sight():
    ending, arm, _ = played("", "", "", "s", "", "")
    assert ending == f"{LeftOut.reason} 0"
    assert [motion.what for motion in arm.done] == ["to the pre-grasp", "out of sight"]


def test_quitting_moves_nothing_more():
    """What is no answer is asked again, and what is grasped cannot be left out."""
    ending, arm, heard = played("", "", "", "", "", "maybe", "s", "q")
    assert ending == "a person ended the run"
    assert [motion.what for motion in arm.done] == ["to the pre-grasp", "straight to the grasp"]
    assert "'maybe' is none of these" in heard
    assert "'s' is none of these" in heard


def test_without_a_terminal_nobody_can_be_asked():
    pipe = io.StringIO("\n")
    with pytest.raises(InputError, match="run it in a terminal"):
        Confirming(planner_of(CELL), pipe, pipe)


def test_a_terminal_that_is_closed_ends_the_run():
    person = Person()
    attendant = Confirming(planner_of(CELL), person.asked, person.told)
    os.write(person.ours, b"\x04")
    with pytest.raises(Stopped):
        attendant.before(Step("gripper opens", opening=0.085, force=20.0))
    person.close()
