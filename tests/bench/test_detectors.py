"""`neugrasp bench --detectors`: every detector on one scene, and those that cannot be loaded say why."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from neugrasp import cli
from neugrasp.bench.command import SpeedTest
from neugrasp.bench.detectors import time_detectors
from neugrasp.detection.contract import Detection
from neugrasp.detection.registry import DetectorSpec
from neugrasp.errors import InputError
from neugrasp.grasp import Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Observation

PAUSE_S = 0.05


@dataclass
class Slow:
    """Waits, and tells what it was shown."""

    options: object

    def detect(self, seen: Observation) -> Detection:
        time.sleep(PAUSE_S)
        assert seen.channels == {"image", "depth"}
        frame = seen.frames[0]
        assert frame.depth is not None
        assert 0.2 < float(frame.depth[frame.depth > 0].mean()) < 1
        stages = {"wait": PAUSE_S}
        return Detection(Grasps.of(()), seen.workspace, Gripper.load("panda"), timing_s=stages)


def refused(options: object) -> Slow:
    raise InputError("no weights at all")


SLOW = DetectorSpec(frozenset({"image", "depth"}), Slow)
REFUSED = DetectorSpec(frozenset({"depth"}), refused)


@pytest.fixture
def _findable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(Path(__file__).parent)


NAMES = ("test_detectors:SLOW", "test_detectors:REFUSED", "antipodal")


@pytest.mark.usefixtures("_findable")
def test_each_sees_what_it_asks_for_and_measuring_sticks_are_left_out():
    _, (slow, without) = time_detectors(SpeedTest(detectors=True, only=NAMES, rounds=2))
    assert len(slow.seconds) == 2
    assert all(PAUSE_S <= seconds < 20 * PAUSE_S for seconds in slow.seconds)
    assert slow.stages == {"wait": PAUSE_S}
    assert without.problem == "no weights at all"
    assert without.seconds == ()


@pytest.mark.usefixtures("_findable")
def test_the_table_and_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = tmp_path / "speed.json"
    words = ["bench", "--detectors", "--rounds", "1", "--only", *NAMES[:2], "--json", str(file)]
    assert cli.main(words) == 0
    shown = capsys.readouterr().out
    assert "wait 0.05" in shown
    assert "no weights at all" in shown
    told = json.loads(file.read_text())
    assert [one["detector"] for one in told["detectors"]] == list(NAMES[:2])
    assert told["command"] == f"neugrasp bench --detectors --only {' '.join(NAMES[:2])} --rounds 1"


def test_its_options_are_for_it_alone(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["bench", "--only", "vgn"]) == 2
    assert "--only and --weights are for --detectors" in capsys.readouterr().err
