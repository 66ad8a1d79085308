"""Detectors that ask an evaluator of grasps play the rounds."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from neugrasp.data.scene_folder import read_scene
from neugrasp.demo.bundled import demo_scenes
from neugrasp.detection.detector import AUTO, JUDGED, NeuGraspDetector
from neugrasp.detection.judge import Judge
from neugrasp.detection.options import DetectorOptions
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.run import evaluate
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.evaluator_file import load_evaluator, save_evaluator, shipped_evaluators
from neugrasp.model.grasp_evaluator import GraspEvaluator
from neugrasp.report.command import Predict
from neugrasp.report.predict import predict

ORACLE, ON_PHOTOS = "neugrasp.evaluation.oracle_baselines:JUDGED", "neugrasp.detection.detector:JUDGED"
"""By module: an installation of before them does not know the names."""


def test_both_have_names():
    entries = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))
    named = entries["project"]["entry-points"]["neugrasp.detectors"]
    assert (named["oracle-evaluator"], named["neugrasp-evaluator"]) == (ORACLE, ON_PHOTOS)


@pytest.fixture(scope="module")
def evaluator(tmp_path_factory) -> Path:
    """One that knows nothing yet."""
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("evaluator") / "young.safetensors"
    about = {"grippers": ["panda"], "threshold": 0.1}
    save_evaluator(path, GraspEvaluator((4, 6, 8), 8), Workspace(), about)
    return path


@pytest.mark.slow
def test_it_plays_a_round_and_says_what_it_asked(evaluator, tmp_path):
    config = Evaluate(
        out=tmp_path,
        detector=ORACLE,
        evaluator=str(evaluator),
        scene="single",
        rounds=1,
        workers=1,
    )
    evaluate(config)
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["attempts"] > 0
    assert metrics["evaluator"] == "young.safetensors"
    assert len(metrics["evaluator_sha256"]) == 64
    assert metrics["threshold"] == metrics["judge"]["threshold"] == 0.1
    assert "--evaluator young.safetensors" in metrics["command"]


@pytest.mark.slow
def test_photos_are_judged_by_it(evaluator):
    views = read_scene(demo_scenes()[0].folder)
    detector = NeuGraspDetector.load(evaluator=evaluator)
    found, again = detector.detect(views), detector.detect(views)
    assert found.grasps
    assert found.threshold == 0.1
    reasons = {"not_the_best_nearby", "quality_below_threshold", "nothing_between_the_fingers"}
    assert set(found.rejected) == reasons
    assert [g.score for g in found.grasps] == [g.score for g in again.grasps]
    with_head = NeuGraspDetector.load().detect(views)
    assert np.array_equal(found.tsdf, with_head.tsdf)
    assert set(found.rejected) != set(with_head.rejected)


def test_it_refuses_what_it_was_not_made_for(evaluator, tmp_path):
    other = tmp_path / "other.safetensors"
    save_evaluator(other, GraspEvaluator((2, 2, 2), 2), Workspace(size=0.6), {})
    with pytest.raises(InputError, match=r"reads a cube of 0\.6 m"):
        NeuGraspDetector.load(evaluator=other)


def test_auto_asks_an_evaluator_that_knows_the_weights(evaluator):
    def asked(**options: Any) -> Judge | None:
        return AUTO.load(DetectorOptions(**options)).judge

    assert asked().config.threshold == load_evaluator("neugrasp").about["threshold"]
    assert asked(gripper="robotiq_2f85").gripper.name == "robotiq_2f85"
    assert asked(weights="neugrasp-tsdf") is None
    assert asked(weights="neugrasp-tsdf", evaluator=str(evaluator)).config.threshold == 0.1
    assert asked(hand_check=False) is None
    assert AUTO.facts(DetectorOptions()) == JUDGED.facts(DetectorOptions())
    assert AUTO.facts(DetectorOptions(weights="neugrasp-tsdf"))["hand_check"]


@pytest.mark.slow
def test_predict_asks_the_bundled_one(tmp_path):
    run = Predict(scene=demo_scenes()[0].folder, out=tmp_path / "out", detector=ON_PHOTOS)
    assert "grasps, the best with score" in predict(run)
    grasps = json.loads((tmp_path / "out" / "grasps.json").read_text())["grasps"]
    assert all(grasp["score"] >= load_evaluator("neugrasp").about["threshold"] for grasp in grasps)


@pytest.mark.slow
def test_another_gripper_is_judged_as_another_gripper(evaluator):
    views = read_scene(demo_scenes()[0].folder)
    found = [
        NeuGraspDetector.load(evaluator=evaluator, gripper=gripper).detect(views)
        for gripper in ("panda", "robotiq_2f85")
    ]
    assert found[1].gripper.name == "robotiq_2f85"
    assert found[1].grasps
    assert found[0].grasps[0].score != found[1].grasps[0].score


def test_the_bundled_one_is_small_and_knows_the_panda():
    (path,) = shipped_evaluators().values()
    assert path.stat().st_size < 500_000
    about = load_evaluator("neugrasp").about
    assert "panda" in about["grippers"]
    # Many of those kept aside are grasps that an evaluator likes, or is unsure of.
    assert about["scores"]["auc"] > 0.89
    assert about["scores"]["calibration_error"] < 0.02


@pytest.mark.slow
def test_how_long_it_takes_is_told():
    program = Path(__file__).parents[2] / "benchmarks" / "evaluator_speed.py"
    words = [sys.executable, str(program), "--times", "1", "--threads", "1"]
    told = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert len(told.splitlines()) == 5
    assert "the whole search" in told
