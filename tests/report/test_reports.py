"""Both reports hold everything themselves, and say what was found."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from neugrasp import cli
from neugrasp.detection.contract import Detection
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.detection.explanation import explain
from neugrasp.doctor.capture import Capture
from neugrasp.doctor.examination import examine
from neugrasp.doctor.report import report
from neugrasp.geometry.pose import rigid
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Views
from neugrasp.report.prediction import prediction_report

VOID = {"meta", "img", "br", "link"}
DOWN = rigid(np.diag([1.0, -1.0, -1.0]), (0.15, 0.15, 0.09))


class Reader(HTMLParser):
    """Checks that tags are closed in order, and collects what a page would load."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.loaded: list[str] = []
        self.rows = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.rows += tag == "tr"
        self.loaded += [value or "" for key, value in attrs if key in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def read(page: str) -> Reader:
    reader = Reader()
    reader.feed(page)
    assert reader.open == []
    assert all(source.startswith("data:image/jpeg;base64,") for source in reader.loaded)
    assert not re.search(r"https?://|url\(|@import", page)
    return reader


@pytest.fixture
def views(make_record: Callable) -> Views:
    return make_record(size=128).views()


def detection(views: Views, grasps: tuple[Grasp, ...], tsdf: np.ndarray) -> Detection:
    rejected = {
        "off_the_surface": 61220,
        "quality_below_threshold": 2514,
        "too_narrow": 0,
        "too_wide_for_the_gripper": 266,
        "not_the_best_nearby": 0,
    }
    seconds = {"images": 0.5, "reconstruct": 2.0}
    gripper = Gripper.load("panda")
    return Detection(Grasps.of(grasps), views.workspace, gripper, tsdf, rejected, 0.83, 0.9, seconds)


def test_no_grasps_are_explained(views: Views):
    text = explain(detection(views, (), np.zeros((40, 40, 40), dtype=np.float32)))
    assert (
        text
        == "0 of 64,000: 61,220 off the surface, 2,514 below 0.9 (best 0.83), 266 too wide for the gripper"
    )


def test_an_empty_table_is_explained(views: Views):
    nothing = replace(detection(views, (), np.zeros((40, 40, 40), np.float32)), rejected={"too_narrow": 0})
    assert explain(nothing) == "nothing stands on the table where the hand could come to it"


@pytest.mark.slow
def test_the_report_of_a_capture_shows_every_photo_and_every_finding(views: Views):
    diagnosis = examine(Capture.of(views))
    reader = read(report(diagnosis, "a <b> & c"))
    assert reader.rows == 1 + len(diagnosis.findings)
    assert len(reader.loaded) == 4 * len(views)
    assert "a &lt;b&gt; &amp; c" in report(diagnosis, "a <b> & c")


@pytest.mark.slow
@pytest.mark.parametrize("count", [0, 40])
def test_the_report_of_a_prediction_holds_everything(
    views: Views, ball_on_table: Callable[..., np.ndarray], count: int
):
    grid = ball_on_table((0.15, 0.15, 0.08), 0.03)
    grasps = tuple(Grasp(DOWN, 0.06, 0.99 - 0.001 * i) for i in range(count))
    diagnosis = examine(Capture.of(views))
    page = prediction_report("ball", views, detection(views, grasps, grid), diagnosis)
    reader = read(page)
    assert len(reader.loaded) == 2 * len(views) + 2  # a slice and the legend, too
    for words in ("61,220", "below 0.9 (best 0.83)", "too wide for the gripper", "reconstruct", "2.50"):
        assert words in page
    assert ("10 more in grasps.json" in page) == (count == 40)
    assert ("None." in page) == (count == 0)


@pytest.mark.slow
def test_a_prediction_without_any_surface_still_has_a_report(views: Views):
    empty = detection(views, (), np.ones((40, 40, 40), dtype=np.float32))
    read(prediction_report("x", views, empty, examine(Capture.of(views))))


class Found:
    """A detector with one answer."""

    gripper = Gripper.load("panda")

    def detect(self, views: Views) -> Detection:
        return detection(views, (), np.ones((40, 40, 40), dtype=np.float32))


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NeuGraspDetector, "load", classmethod(lambda *_, **__: Found()))


@pytest.mark.slow
def test_predict_writes_the_report_and_explains_no_grasps(
    found: None, bad_and_good: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    _, good = bad_and_good
    assert cli.main(["predict", str(good), "--out", str(tmp_path / "out"), "--report"]) == 0
    assert "no grasps: 0 of 64,000: 61,220 off the surface" in capsys.readouterr().out
    read((tmp_path / "out/report.html").read_text())


@pytest.mark.slow
def test_predict_refuses_on_red_unless_forced(
    found: None, bad_and_good: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    bad, _ = bad_and_good
    arguments = ["predict", str(bad), "--out", str(tmp_path / "out"), "--examine"]
    assert cli.main(arguments) == 2
    error = capsys.readouterr().err
    assert "the doctor says red" in error
    assert "view 1: shifted by" in error
    assert "--force" in error
    assert not (tmp_path / "out").exists()
    assert cli.main([*arguments, "--force"]) == 0
    assert (tmp_path / "out/grasps.json").exists()


@pytest.mark.slow
def test_doctor_ends_with_1_on_red_and_writes_what_it_is_asked_for(
    bad_and_good: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    bad, good = bad_and_good
    assert cli.main(["doctor", str(bad), "--report", str(tmp_path / "deep/bad.html")]) == 1
    assert f"{bad}: red" in capsys.readouterr().out
    read((tmp_path / "deep/bad.html").read_text())
    assert cli.main(["doctor", str(good)]) == 0
    assert f"{good}: green" in capsys.readouterr().out
    assert cli.main(["doctor", str(tmp_path / "nothing")]) == 1
    assert "scene.json: missing" in capsys.readouterr().out
    assert cli.main(["doctor", str(good), "--fix", str(tmp_path / "fixed")]) == 2
    assert "nothing was found that can be corrected" in capsys.readouterr().err
