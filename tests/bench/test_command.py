"""`neugrasp bench` from the command line to its table and its file, on a tiny network."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from neugrasp import cli
from neugrasp.bench import machine, measure
from neugrasp.bench.command import SpeedTest
from neugrasp.bench.report import HEADER
from neugrasp.bench.run import run
from neugrasp.bench.workloads import fresh_model
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.gripper import Gripper
from neugrasp.training.recipes import tiny

INFERENCE = {
    "prepare", "encode images", "backgrounds", "foreground", "voxel maps", "volumes", "field query",
    "grasp head", "selection", "other",
}  # fmt: skip
TRAINING = {
    "encode images", "foreground", "voxel maps", "volumes", "field query", "grasp head", "ray field",
    "ray weights", "grid rays", "losses", "backward", "optimiser", "other",
}  # fmt: skip


@pytest.fixture
def _tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    def detector(shape: str, seed: int, device: torch.device) -> NeuGraspDetector:
        return NeuGraspDetector(fresh_model(tiny().model, seed), Gripper.load("panda"), device=device)

    monkeypatch.setattr(measure, "shaped_detector", detector)
    monkeypatch.setattr(measure, "shaped_training", lambda *_: replace(tiny(), view_dropout=0.0))
    monkeypatch.setattr(machine, "PRODUCTS", {"cpu": (64, 128)})
    monkeypatch.setattr(machine, "COPIED", {"cpu": 2**20})


@pytest.mark.usefixtures("_tiny")
@pytest.mark.slow
def test_the_file_holds_every_stage_with_its_roofline(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = tmp_path / "new" / "speed.json"
    arguments = ["bench", "--rounds", "2", "--views", "3", "--seed", "4", "--json", str(file)]
    assert cli.main(arguments) == 0
    report = json.loads(file.read_text())
    assert report["format"] == "neugrasp-bench"
    assert report["command"] == "neugrasp bench --views 3 --rounds 2 --seed 4"
    for name in ("photos_to_grasps", "training_step"):
        assert report[f"{name}_s"] > 0
    assert report["files_to_grasps_s"] > report["photos_to_grasps_s"]
    assert {"float32", "bfloat16"} == set(report["machine"]["products_flop_per_s"])
    for part, stages in (("inference", INFERENCE), ("training", TRAINING)):
        rows = {row["stage"]: row for row in report[part]["stages"]}
        assert set(rows) == stages
        for name in stages - {"other", "backgrounds"}:
            assert rows[name]["floor_s"] > 0, name
            assert rows[name]["times_the_floor"] > 0, name
        total = report[part]["total"]
        assert total["cpu_s"] > 0
        assert total["floor_s"] == pytest.approx(sum(row["floor_s"] or 0 for row in rows.values()))
        assert sum(row["seconds"] for row in rows.values()) == pytest.approx(total["seconds"], rel=0.5)
    assert [row["stage"] for row in report["inference"]["outside"]] == ["load", "new backgrounds"]
    _check_table(capsys.readouterr().out, report, file)


def _check_table(printed: str, report: dict, file: Path) -> None:
    lines = printed.splitlines()
    assert lines.count(HEADER) == 2
    for row in (*report["inference"]["stages"], *report["training"]["stages"]):
        assert any(line.startswith(f"{row['stage']} ") for line in lines), row["stage"]
    assert max(len(line) for line in lines) <= 110
    assert lines[-2:] == [str(file), "next: docs/bench.md says what the columns mean"]


@pytest.mark.slow
@pytest.mark.usefixtures("_tiny")
def test_one_part_on_one_thread():
    torch.set_num_threads(before := torch.get_num_threads())
    text = run(SpeedTest(part="inference", rounds=1, threads=1))
    assert "A training step" not in text
    assert "1 threads" in text
    assert torch.get_num_threads() == before


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--views", "9", "--views 9: a scene has 1 to 8 views"),
        ("--rounds", "0", "--rounds 0: must be at least 1"),
        ("--threads", "0", "--threads 0: must be at least 1"),
    ],
)
def test_options_that_cannot_be(option: str, value: str, message: str, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["bench", option, value]) == 2
    assert message in capsys.readouterr().err


def test_a_machine_without_cuda_says_so(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert cli.main(["bench", "--device", "cuda"]) == 2
    assert "use --device cpu" in capsys.readouterr().err


def test_the_line_that_repeats_a_run_is_read_back():
    settings = SpeedTest(network="paper", part="training", threads=2)
    line = "neugrasp bench --network paper --part training --threads 2"
    assert settings.command() == line
