"""The page of a run in a real browser: what it shows, and that its button stops the arm of the twin."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from browsers import no_browser
from neugrasp.detection.contract import Detection
from neugrasp.evaluation.episode import UNFINISHED, Attempt, Episode, read_episode
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import View, Views
from neugrasp.robot.attended import AttendedGripper, Step
from neugrasp.robot.errors import Stopped
from neugrasp.robot.rehearsal import _PaperGripper
from neugrasp.robot.workcell import cameras_of
from neugrasp.viewer.browser import Browser
from neugrasp.viewer.live import LivePage
from robot_cells import TWIN, PaperArm, down_at, example

MISSING = no_browser("viser")
pytestmark = [
    pytest.mark.skipif(bool(MISSING), reason=MISSING),
    pytest.mark.skipif(find_spec("ompl") is None, reason="needs neugrasp[robot]"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:websockets.*"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
PATIENCE = 240
BOUND_S = 30.0
"""Seconds from the press of the button to the end of the program, on a busy machine; the motion under way
would last more than a minute."""
PRESS = "[...document.querySelectorAll('button')].find(b => b.innerText.includes('STOP')).click()"
WORDS = "document.body ? document.body.innerText : ''"


def until(answer: Callable[[], Any]) -> Any:
    end = time.monotonic() + PATIENCE
    while not (found := answer()) and time.monotonic() < end:
        time.sleep(0.1)
    return found


@pytest.mark.slow
def test_the_page_follows_and_its_button_stops_arms_that_come_later():
    """Without a browser."""
    cell, arm, late = example(), PaperArm(np.zeros(6)), PaperArm(np.zeros(6))
    with LivePage("a run", cell.workspace, cell.gripper.gripper, "127.0.0.1", 0) as page:
        page.meet(arm)
        blank = np.full((360, 640, 3), 90, dtype=np.uint8)
        views = tuple(View(camera, blank, blank, name=f"{i}") for i, camera in enumerate(cameras_of(cell)))
        page.stage("detecting", Views(views, cell.workspace))
        assert {f"cameras/{i}/photo" for i in range(4)} < set(page._scene.names)
        grasps = [Grasp(down_at(0.5, 0.0, height), 0.03) for height in (0.05, 0.06, 0.07)]
        tsdf = np.ones((40, 40, 40), dtype=np.float32)
        tsdf[18:22, 18:22, 6:12] = -1
        page.stage("planning", Detection(Grasps.of(grasps), cell.workspace, Gripper.load("panda"), tsdf))
        assert {"surface", "grasps/000", "grasps/002"} < set(page._scene.names)
        page.before(Step("a grasp of score 1.00", grasp=grasps[1]))
        assert "grasps/001" not in page._scene.names
        drawn = page._data.moments[0].grasps[0].grasp
        np.testing.assert_allclose(drawn.position, [0.15, 0.15, 0.11], atol=1e-9)
        page.before(Step("gripper opens", opening=0.08))
        assert "moving: gripper opens" in page._state.content
        page.told(Episode(0, 2, UNFINISHED, (attempt("slipped on lifting"),), skipped={"unreachable": 2}))
        assert "0 of 1 picks held" in page._counts.content
        assert "2 unreachable" in page._counts.content
        page.stop()
        assert arm.stops == 1
        page.meet(late)
        assert late.stops == 1
        fingers = AttendedGripper(_PaperGripper(0.085, at=0.03), page)
        with pytest.raises(Stopped, match="stopped by the button"):
            fingers.move(0.085, 20.0, 5.0)
        assert fingers.opening() == 0.03
        assert "stopped by the button" in page._state.content


def attempt(reason: str) -> Attempt:
    pose = (0.0, 0.0, 0.0, 1.0)
    return Attempt(0, 0, 1, 1, 0.9, 0.03, (0.0, 0.0, 0.1), pose, False, reason, False, 0, 0.0, {}, {}, {})


def stopped_in(process: subprocess.Popen[str], moment: str) -> str:
    """Presses the button when the page says the moment; what the program says from then on."""
    assert process.stderr is not None
    said: list[str] = []
    url = None
    while url is None:
        said.append(process.stderr.readline())
        assert said[-1], "".join(said)
        url = re.search(r"open (http://\S+) in a browser", said[-1])
    with Browser(url[1], size=(900, 600)) as browser:
        assert until(lambda: moment in browser.evaluate(WORDS)), browser.evaluate(WORDS)
        browser.evaluate(PRESS)
        pressed = time.monotonic()
        rest = process.communicate(timeout=4 * BOUND_S)[1]
        assert time.monotonic() - pressed < BOUND_S
    return rest


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("moment", "speed"), [("moving: to view", "0.02"), ("moving: to the pre-grasp", "0.1")]
)
def test_the_button_stops_a_motion_of_the_twin(tmp_path: Path, moment: str, speed: str):
    """So slow a cell that every motion lasts; the run ends with its reason, and the log is whole."""
    words = ["run", str(TWIN), "--out", str(tmp_path / "run"), "--detector", "oracle", "--view"]
    process = subprocess.Popen(
        [sys.executable, "-m", "neugrasp", *words, "--port", "0", "--speed", speed],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        rest = stopped_in(process, moment)
    finally:
        process.kill()
    assert process.returncode == 2
    assert "the arm was stopped" in rest
    assert "the same command goes on" in rest
    file = tmp_path / "run/rounds/000000.json"
    if file.exists():
        assert read_episode(file).ending == UNFINISHED
    assert (tmp_path / "run/run.json").is_file()
