"""The paper's table: which rows it has, that it goes on where it stopped, and what it says."""

from __future__ import annotations

import importlib
import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image as Picture

from neugrasp.errors import InputError
from neugrasp.evaluation import paper_table
from neugrasp.evaluation.commands import Table
from neugrasp.evaluation.compared_methods import COMPARED_METHODS, PAPER, GivenWeights, compared_method
from neugrasp.evaluation.paper_table import planned, run


@pytest.fixture
def scene_renderer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> type:
    monkeypatch.setenv("NEUGRASP_CACHE", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(Path(__file__).parent.parent / "simulation")
    return importlib.import_module("noise_renderer").NoiseRenderer


def test_the_paper_has_every_packed_cell():
    cells = {key for key in PAPER if key[1] == "packed"}
    assert len(cells) == len(COMPARED_METHODS) * 4
    for figures in PAPER.values():
        *rates, error = map(float, figures.split(" / "))
        assert len(rates) == 3
        assert all(0 < rate <= 100 for rate in rates)
        assert 0 < error < 1


def test_weights_are_borrowed_where_none_are_given():
    given = GivenWeights(("vgn=a.pth", "rgbgrasp-gt=b.pth"))
    wanted = {"vgn": "a.pth", "swindr-vgn": "a.pth", "rgbgrasp-gt": "b.pth", "neugrasp": "neugrasp"}
    assert {name: given.of(name) for name in wanted} == wanted
    with pytest.raises(InputError, match=r"--weights a\.pth: give a detector and a file"):
        GivenWeights(("a.pth",))


def test_detectors_without_weights_are_left_out_unless_they_are_asked_for():
    config = Table("packed", weights=("vgn=nowhere.pth",))
    rows, left_out = planned(config)
    assert "neugrasp" in {row.system.detector for row in rows}
    assert "nowhere.pth" in left_out["vgn"]
    with pytest.raises(InputError, match=r"nowhere\.pth"):
        planned(replace(config, detectors=("vgn",)))


@pytest.mark.slow
def test_slow_systems_play_fewer_rounds(monkeypatch: pytest.MonkeyPatch):
    slow = replace(compared_method("antipodal"), most_rounds=30)
    monkeypatch.setitem(COMPARED_METHODS, "antipodal", slow)
    for asked, played in ((None, 30), (100, 30), (5, 5)):
        rows, _ = planned(Table("pile", rounds=asked, detectors=("antipodal", "oracle")))
        assert {r.evaluation.rounds for r in rows if r.system is slow} == {played}
        assert {r.evaluation.rounds for r in rows if r.system is not slow} == {asked}


@pytest.mark.slow
def test_rows_are_played_once_and_compared(
    scene_renderer: type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    config = Table(
        "single", out=tmp_path, rounds=2, detectors=("neugrasp", "antipodal"), strategies=("top",), workers=1
    )
    said = run(config, scene_renderer)
    page = (tmp_path / "single.md").read_text()
    assert said.startswith(page)
    assert said.splitlines()[-1].startswith("next: neugrasp failures")
    told = json.loads((tmp_path / "single.json").read_text())
    assert [row["detector"] for row in told["rows"]] == ["neugrasp", "antipodal"] * 2
    ours, other = told["rows"][:2]
    assert ours["against_neugrasp"] is None
    difference = other["against_neugrasp"]["DR"]["difference"]
    assert math.isclose(difference, other["DR"] - ours["DR"], abs_tol=0.011)
    assert f"{difference:+.1f} (" in page
    assert ours["weights_sha256"][:16] in page

    def twice(*_: object) -> None:
        raise AssertionError("played again")

    monkeypatch.setattr("neugrasp.evaluation.episode_runner.EpisodeRunner.play", twice)
    assert run(config, scene_renderer) == said


@pytest.mark.slow
def test_the_paper_stands_beside_packed_rows(scene_renderer: type, tmp_path: Path):
    config = Table(
        "packed", out=tmp_path, rounds=1, detectors=("neugrasp",), strategies=("random",), workers=1
    )
    assert "| 86.3 / 86.0 / 81.0 / 0.153 |" in run(config, scene_renderer)


@pytest.mark.slow
def test_a_picture_of_the_surfaces(scene_renderer: type, tmp_path: Path):
    config = Table("single", out=tmp_path, detectors=("neugrasp", "oracle"), picture=True)
    path = tmp_path / "single_surfaces.png"
    assert run(config, scene_renderer).splitlines()[0] == str(path)
    with Picture.open(path) as picture:
        # A photo, the truth and two detectors in a row.
        assert picture.width > 4 * 320
        assert picture.height > 2 * 320
    assert not list(tmp_path.glob("single/*"))


def test_nothing_to_play_is_said(monkeypatch: pytest.MonkeyPatch):
    only = {"vgn": compared_method("vgn")}
    monkeypatch.setattr(paper_table, "COMPARED_METHODS", only)
    with pytest.raises(InputError, match="no detector can be used"):
        planned(Table("pile", weights=("vgn=nowhere.pth",)))
