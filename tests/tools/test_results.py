"""The page of results."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path
from typing import Any

import pytest

from neugrasp.errors import InputError
from neugrasp.evaluation.protocols import protocol_of
from neugrasp.evaluation.results_io import NEEDED, facts_of
from neugrasp.evaluation.results_io import played as played_rounds
from neugrasp.evaluation.scores import scores
from results import main, write_results
from rounds_by_hand import metrics, played

ROOT = Path(__file__).parents[2]


def test_the_page_of_results_has_a_row_and_an_origin_for_every_file(tmp_path: Path):
    folder = tmp_path / "results"
    (folder / "second").mkdir(parents=True)
    (folder / "first.json").write_text(json.dumps(metrics([played(0, "++-"), played(1, "--")])))
    other = metrics([played(0, "+")], detector="oracle", protocol="vgn", depth=None)
    (folder / "second" / "metrics.json").write_text(json.dumps(other))
    page = write_results(folder, tmp_path / "results.md").read_text()
    assert "| vgn (vgn_conv.pth, exact depth) | packed | any | released | random | 40.0 (" in page
    assert "| oracle (vgn_conv.pth) |" in page
    assert "2 of 5" in page
    assert page.index("Protocol `paper`") < page.index("Protocol `vgn`")
    assert "- first: `neugrasp evaluate ...` (commit abc1234, seed 0, here)" in page
    assert write_results(folder, tmp_path / "again.md").read_text() == page


@pytest.mark.parametrize(
    ("changes", "figures"),
    [
        ({}, ""),
        ({"depth": "stereo"}, "47.9 / 40.5 / 36.7 / 0.205"),
        ({"depth": "stereo", "views": "paper"}, ""),
        ({"depth": "stereo", "split": "train"}, ""),
        ({"depth": "stereo", "protocol": "vgn"}, ""),
        ({"detector": "neugrasp", "depth": None, "scene": "pile"}, "65.3 / 64.5 / 43.2 / 0.171"),
        ({"detector": "neugrasp", "depth": None, "scene": "pile", "strategy": "highest"}, ""),
        ({"detector": "neugrasp", "depth": None, "scene": "pile", "trained": {"recipe": "tsdf"}}, ""),
    ],
)
def test_the_papers_figures_stand_beside_rows_of_their_kind(
    tmp_path: Path, changes: dict[str, Any], figures: str
):
    (tmp_path / "row.json").write_text(json.dumps(metrics([played(0, "+")], **changes)))
    page = write_results(tmp_path, tmp_path / "results.md").read_text()
    (row,) = (line for line in page.splitlines() if line.startswith(("| vgn", "| neugrasp")))
    assert row.endswith(f"| {figures} |")


def test_what_came_off_the_table_is_told_by_material_where_the_detector_saw_materials(tmp_path: Path):
    share = {"transparent": {"objects": 4, "taken": 3, "share": 75.0}}
    for name, detector in (("ours", "neugrasp"), ("stick", "oracle")):
        row = metrics([played(0, "+")], detector=detector, depth=None, by_material=share)
        (tmp_path / f"{name}.json").write_text(json.dumps(row))
    page = write_results(tmp_path, tmp_path / "results.md").read_text()
    assert "| ours | 3 of 4, 75.0 % |" in page
    assert "| stick | 3 of 4" not in page


@pytest.mark.parametrize(
    ("samples", "told"), [(4, ""), (1, ", 1 sample a pixel"), (2, ", 2 samples a pixel")]
)
def test_photos_of_other_noise_are_named(tmp_path: Path, samples: int, told: str):
    row = metrics([played(0, "+")], detector="neugrasp", depth=None, samples=samples)
    (tmp_path / "row.json").write_text(json.dumps(row))
    page = write_results(tmp_path, tmp_path / "results.md").read_text()
    assert f"| neugrasp (vgn_conv.pth{told}) |" in page


def test_what_each_part_allows_stands_side_by_side(tmp_path: Path):
    """Of rows alike the longest counts, and none of other weights or rules."""
    rows = {
        "perfect": {"detector": "perfect-judge"},
        "perfect_pile": {"detector": "perfect-judge", "scene": "pile"},
        "photos": {"detector": "neugrasp"},
        "others": {"detector": "neugrasp", "weights": "neugrasp-tsdf.safetensors"},
        "elsewhere": {"detector": "neugrasp", "after_failure": "elsewhere"},
        "lab": {"detector": "neugrasp", "domain": {"name": "lab"}},
    }
    for name, changes in rows.items():
        rounds = [played(i, "+-") for i in range(1 if name == "photos" else 2)]
        content = metrics(rounds, depth=None, materials="transparent-specular", strategy="random")
        content["weights"] = "neugrasp.safetensors"
        (tmp_path / f"{name}.json").write_text(json.dumps(content | changes))
    page = write_results(tmp_path, tmp_path / "results.md").read_text()
    (told,) = (line for line in page.splitlines() if "(`perfect-judge`)" in line)
    assert told.count("2 rounds") == 2
    (told,) = (line for line in page.splitlines() if "rules (`neugrasp`)" in line)
    assert told.endswith("1 rounds | - |")
    (tmp_path / "perfect.json").unlink()
    (tmp_path / "perfect_pile.json").unlink()
    assert "What each part allows" not in write_results(tmp_path, tmp_path / "results.md").read_text()


def test_ablations_have_a_table_of_their_own_beside_the_papers(tmp_path: Path):
    (tmp_path / "row.json").write_text(json.dumps(metrics([played(0, "+")])))
    (tmp_path / "ablation").mkdir()
    for recipe, scene, course in (
        ("small", "packed", "+++-"),
        ("without-occupancy", "packed", "+-"),
        ("small", "pile", "-"),
    ):
        trained = {"recipe": recipe, "steps": 1000, "scenes": 300}
        row = metrics([played(0, course)], detector="neugrasp", scene=scene, trained=trained)
        (tmp_path / "ablation" / f"{recipe}_{scene}.json").write_text(json.dumps(row))
    page = write_results(tmp_path, tmp_path / "results.md").read_text()
    table = page[page.index("## Ablation") :].splitlines()
    cells = {line.split(" | ")[0]: line.split(" | ") for line in table if line.startswith("| ")}
    full, without = cells["| full"], cells["| without the occupancy prior (V_occ)"]
    assert full[1] == without[1] == "1000, 300"
    assert full[2].startswith("0.0 (")
    assert full[6].startswith("75.0 (")
    assert without[2:6] == ["-"] * 4
    assert without[6].startswith("50.0 (")
    assert cells["| paper: full"][2:10] == ["65.2", "67.5", "45.6", "0.164", "86.3", "86.0", "81.0", "0.153"]
    assert "| paper: without backgrounds" not in cells
    assert "| neugrasp" not in page[: page.index("## Ablation")]


def test_the_full_model_is_compared_by_the_budget_of_its_training(tmp_path: Path):
    (tmp_path / "row.json").write_text(json.dumps(metrics([played(0, "+")])))
    (tmp_path / "ablation").mkdir()
    for steps, scenes, recipe, course in (
        (50, 1000, "small", "+"),
        (150, 1000, "small", "+++-"),
        (50, 300, "small", "+-"),
        (50, 1000, "tsdf", "+"),
    ):
        trained = {"recipe": recipe, "steps": steps, "scenes": scenes}
        row = metrics([played(0, course)], detector="neugrasp", trained=trained)
        (tmp_path / "ablation" / f"{recipe}_{steps}_{scenes}.json").write_text(json.dumps(row))
    page = write_results(tmp_path, tmp_path / "results.md").read_text()
    ablation, curve = page[page.index("## Ablation") :].split("What more scenes and steps are worth")
    assert "| full | 50, 1000 |" in ablation
    assert "| 50, 300 |" not in ablation
    assert "| 150, 1000 |" not in ablation, "the control had no such budget"
    cells = [line.split(" | ") for line in curve.splitlines() if line.startswith("| ")][1:]
    assert [(cell[0], cell[1], cell[6].split(" ")[0]) for cell in cells] == [
        ("| 50", "300", "50.0"),
        ("| 50", "1000", "100.0"),
        ("| 150", "1000", "75.0"),
    ]

    for some in ("50_300", "150_1000"):
        (tmp_path / "ablation" / f"small_{some}.json").unlink()
    page = write_results(tmp_path, tmp_path / "results.md").read_text()
    assert "What more scenes" not in page


def test_foreign_files_and_empty_folders_are_refused(tmp_path: Path):
    with pytest.raises(InputError, match="holds neither"):
        write_results(tmp_path, tmp_path / "out.md")
    (tmp_path / "x.json").write_text("{}")
    with pytest.raises(InputError, match="holds neither"):
        write_results(tmp_path, tmp_path / "out.md")
    (tmp_path / "x.json").write_text("{")
    with pytest.raises(InputError, match=r"x\.json: not valid JSON"):
        write_results(tmp_path, tmp_path / "out.md")


@pytest.mark.parametrize("foreign", ["{}", "[1, 2]", '{"format": "neugrasp-grasps", "version": 1}'])
def test_other_json_is_left_out_of_the_results_with_a_word(
    tmp_path: Path, foreign: str, caplog: pytest.LogCaptureFixture
):
    row = metrics([played(0, "+")])
    (tmp_path / "ours.json").write_text(json.dumps(row))
    page = write_results(tmp_path, tmp_path / "page" / "alone.md").read_text()
    (tmp_path / "package.json").write_text(foreign)
    assert write_results(tmp_path, tmp_path / "page" / "both.md").read_text() == page
    assert "package.json: not the metrics.json" in caplog.text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scene": None}, "scene is None; it must be a text"),
        ({"attempts": -1}, "attempts is -1"),
        ({"SR": "high"}, "SR is 'high'"),
        ({"SR_ci": [1]}, "SR_ci is not"),
        ({"failures": {"slipped": True}}, "failures.slipped is True"),
        ({"version": 2}, "version is 2"),
    ],
)
def test_a_damaged_row_of_the_results_is_named(tmp_path: Path, change: dict[str, object], message: str):
    (tmp_path / "row.json").write_text(json.dumps(metrics([played(0, "+")]) | change))
    with pytest.raises(InputError, match=message) as caught:
        write_results(tmp_path, tmp_path / "out.md")
    assert "row.json" in str(caught.value)


def test_a_page_that_cannot_be_made_leaves_what_is_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    own = tmp_path / "own.json"
    own.write_text('{"mine": 1}')
    assert main(["--folder", str(tmp_path), "--out", str(own)]) == 2
    assert "holds neither" in capsys.readouterr().err
    assert own.read_text() == '{"mine": 1}'


def test_the_page_of_the_repository_is_that_of_its_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(ROOT)
    page = write_results(Path("docs/results"), tmp_path / "page.md")
    assert page.read_text() == (ROOT / "docs/results.md").read_text()


def test_rounds_that_an_older_version_played_give_the_figures_that_were_kept(tmp_path: Path):
    name = "neugrasp_single_transparent-specular"
    with tarfile.open(ROOT / f"docs/results/rounds/{name}.tar.xz") as archive:
        archive.extractall(tmp_path, filter="data")
    facts = facts_of(tmp_path / name, NEEDED)
    now = scores(played_rounds(tmp_path / name), protocol_of(facts["protocol"]))
    kept = json.loads((ROOT / f"docs/results/{name}.json").read_text())
    assert now["rounds"] == 56
    assert now == {key: kept[key] for key in now}


def test_rows_of_one_command_share_its_line(tmp_path: Path):
    for name, commit in (("a", "abc1234"), ("b", "abc1234"), ("c", "def5678")):
        (tmp_path / f"{name}.json").write_text(json.dumps(metrics([played(0, "+")], commit=commit)))
    page = write_results(tmp_path, tmp_path / "results.md").read_text()
    origins = [line.split(":")[0] for line in page.splitlines() if line.startswith("- ")]
    assert origins == ["- a, b", "- c"]
