"""A real cell from end to end, with a controller and a gripper that are none and drawn photos.

Drivers, fence, planner, loop and files are those of a real cell. Nothing here was tried on an arm.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from fake_hardware import FakeUr, Fingers, serving
from neugrasp.data.scene_folder import read_scene
from neugrasp.detection.contract import Detection
from neugrasp.detection.registry import PHOTOS, DetectorSpec
from neugrasp.errors import InputError
from neugrasp.evaluation.episode import read_episode
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Image, Views
from neugrasp.operation import capture, hardware, run
from neugrasp.operation.command import Capture, Run
from neugrasp.robot.errors import ProtectiveStop, RobotError
from neugrasp.robot.robotiq import PORT
from robot_cells import TWIN, down_at

pytestmark = pytest.mark.skipif(
    find_spec("ompl") is None or find_spec("rtde_control") is None, reason="needs neugrasp[robot]"
)


@dataclass
class Pencil:
    """A camera that draws: a bright square where something lies, noise elsewhere."""

    things: int = 0
    photos: int = 0

    def __enter__(self) -> Pencil:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def photo(self, timeout_s: float) -> Image:
        self.photos += 1
        rng = np.random.default_rng(self.photos)
        image = rng.integers(90, 94, (360, 640, 3), dtype=np.uint8)
        if self.things:
            image[150:230, 280:360] = (220, 60, 30)
        return image


@dataclass
class Cell:
    """The file, and what is behind the addresses in it."""

    path: Path
    ur: FakeUr
    fingers: Fingers
    pencil: Pencil = field(default_factory=Pencil)


@pytest.fixture
def cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cell]:
    ur, fingers = FakeUr(), Fingers()
    address = f'address = "{ur.address}"'
    text = TWIN.read_text().split("# What lies on")[0]
    for part, driver in (("arm", "ur"), ("gripper", "robotiq")):
        text = text.replace(f'[{part}]\ndriver = "twin"', f'[{part}]\ndriver = "{driver}"\n{address}')
    text = text.replace('[camera]\ndriver = "twin"', '[camera]\ndriver = "realsense"')
    quick = {
        "joint_speed = 1.5": "joint_speed = 3.1",
        "joint_acceleration = 4.0": "joint_acceleration = 20.0",
    }
    quick |= {"tcp_speed = 0.5": "tcp_speed = 1.5", "approach_speed = 0.12": "approach_speed = 0.5"}
    for slow, fast in quick.items():
        text = text.replace(slow, fast)
    path = tmp_path / "cell.toml"
    path.write_text(text)
    made = Cell(path, ur, fingers)
    monkeypatch.setattr(hardware, "_sensor", lambda cell: made.pencil)
    with serving(fingers, ur.address, PORT):
        yield made
    ur.close()


@dataclass
class Pointing:
    """One grasp in the middle, as long as there is a thing; what it does then is in `happens`."""

    cell: Cell
    clears: bool = True
    happens: str = ""

    def detect(self, seen: Views) -> Detection:
        grasps = Grasps.of([Grasp(down_at(0.5, 0.0, 0.05), 0.03, 0.9)])
        if self.happens:
            self.cell.ur.fault(self.happens)
        self.cell.pencil.things = 0 if self.clears else 1
        return Detection(grasps, seen.workspace, Gripper.load("robotiq_2f85"))


def pointing(monkeypatch: pytest.MonkeyPatch, detector: Pointing) -> None:
    spec = DetectorSpec(PHOTOS, lambda options: detector)
    monkeypatch.setattr(run, "detector_spec", lambda name: spec)


def moves(cell: Cell) -> list[list[float]]:
    return [[float(x) for x in s.split()[2:]] for s in cell.ur.said() if s.startswith("servo")]


@pytest.mark.slow
def test_the_empty_table_then_a_scene(cell: Cell, tmp_path: Path):
    with pytest.raises(InputError, match="no photos of the empty table; take them with"):
        capture.run(Capture(cell.path, tmp_path / "scene"))
    assert not moves(cell)
    said = capture.run(Capture(cell.path, empty=True))
    assert said.splitlines()[0] == str(tmp_path / "cell_empty")
    cell.pencil.things = 1
    capture.run(Capture(cell.path, tmp_path / "scene"))
    scene = read_scene(tmp_path / "scene")
    assert len(scene) == 4
    assert (scene.frames[0].image[190, 320] == (220, 60, 30)).all()
    assert scene.frames[0].background[190, 320].max() < 100
    home = np.deg2rad([130, -110, 110, -90, -90, 0])
    np.testing.assert_allclose(moves(cell)[-1], home, atol=1e-4)


@pytest.mark.slow
def test_a_thing_is_picked_and_dropped_and_the_empty_table_ends_it(
    cell: Cell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    capture.run(Capture(cell.path, empty=True))
    cell.pencil.things, cell.fingers.thing = 1, 150
    pointing(monkeypatch, Pointing(cell))
    said = run.run(Run(cell.path, tmp_path / "run"))
    assert said.splitlines()[0] == "the table is empty; 1 of 1 objects with 1 picks"
    episode = read_episode(tmp_path / "run/rounds/000000.json")
    assert [attempt.reason for attempt in episode.attempts] == ["success"]
    # Told to close once, with the force of the cell file, and open again over the drop.
    told = [line for line in cell.fingers.asked if line.startswith("SET POS")]
    assert [int(line.split()[2]) for line in told] == [3, 255, 3]


@pytest.mark.slow
@pytest.mark.parametrize("word", ["protective", "silent"])
def test_a_fault_ends_the_run_with_its_name_and_nothing_moves(
    cell: Cell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, word: str
):
    capture.run(Capture(cell.path, empty=True))
    cell.pencil.things = 1
    pointing(monkeypatch, Pointing(cell, happens=word))
    before = len(moves(cell))
    with pytest.raises(ProtectiveStop if word == "protective" else RobotError, match="same command goes on"):
        run.run(Run(cell.path, tmp_path / "run"))
    tour = np.array(moves(cell))
    assert before > 0
    np.testing.assert_allclose(tour[-1], np.deg2rad([130, -110, 110, -90, -90, 0]), atol=1e-4)


@pytest.mark.slow
def test_an_arm_that_was_left_anywhere_is_not_driven_blindly(cell: Cell):
    text = cell.path.read_text().replace("out_of_sight = [130.0,", "out_of_sight = [60.0,")
    cell.path.write_text(text.replace("low = [-0.1, -0.75", "low = [-0.9, -0.9"))
    with pytest.raises(RobotError, match=r"70 degrees from out of sight.*with the pendant"):
        capture.run(Capture(cell.path, empty=True))
    assert not moves(cell)


@pytest.mark.slow
def test_measuring_sticks_see_no_photos(cell: Cell, tmp_path: Path):
    with pytest.raises(InputError, match="--detector oracle: a cell has photos, and nothing else"):
        run.run(Run(cell.path, tmp_path / "run", detector="oracle"))


@pytest.mark.slow
def test_where_nothing_can_be_written_nothing_moves(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file; the scene is written into a folder"):
        capture.run(Capture(TWIN, out=tmp_path / "file"))
    with pytest.raises(OSError, match="Not a directory"):
        capture.run(Capture(TWIN, out=tmp_path / "file" / "deeper"))
