"""The evaluator of grasps learns, can be stopped anywhere, and says how far it can be believed."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import strategies as st
from safetensors.torch import load_file, save_file

from ball_lessons import lesson, write_lessons
from damage import damaged_json, fuzz, many, split, with_metadata
from neugrasp.data.lessons import ABOUT, Lesson, gripper_of, joined, read_lesson, write_lesson
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.model.evaluator_file import load_evaluator, save_evaluator
from neugrasp.model.grasp_evaluator import GraspEvaluator
from neugrasp.training.evaluator import EvaluatorConfig, EvaluatorRun, train_evaluator
from neugrasp.training.evaluator_scores import judgement, probabilities, reliability_table
from neugrasp.training.evaluator_trials import seen_of

WORKSPACE, PANDA = Workspace(), Gripper.load("panda")
TINY = EvaluatorConfig(steps=6, batch=16, widths=(4, 6, 8), hidden=8, checkpoint_every=2)


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return write_lessons(tmp_path_factory.mktemp("lessons"), 12)


def test_a_lesson_comes_back_as_it_was_written(tmp_path):
    both = joined([lesson(1, 5), lesson(2, 3)])
    write_lesson(tmp_path / "both.npz", both)
    again = read_lesson(tmp_path / "both.npz")
    assert again.seen.tolist() == [0] * 5 + [1] * 3
    for name in ("grids", "positions", "quaternions", "success", "free", "seen"):
        assert np.array_equal(getattr(again, name), getattr(both, name))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seen": np.full(40, 3, np.uint8)}, "seen names number 3 of 1 grids"),
        ({"positions": np.zeros((39, 3), np.float32)}, "positions is float32"),
        ({"grids": np.zeros((1, 4, 4, 4), np.float16)}, "grids have the shape"),
    ],
)
def test_a_damaged_lesson_is_named(tmp_path, change, message):
    write_lesson(tmp_path / "bad.npz", replace(lesson(1), **change))
    with pytest.raises(InputError, match=rf"bad\.npz: {message}"):
        read_lesson(tmp_path / "bad.npz")


@pytest.fixture(scope="module")
def weights(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("evaluator") / "evaluator.safetensors"
    save_evaluator(path, GraspEvaluator((4, 6, 8), 8), WORKSPACE, {"threshold": 0.5})
    return path


@pytest.mark.slow
@many
def test_nothing_said_of_an_evaluator_ends_in_anything_but_one_error(examples, weights, tmp_path):
    header, rest = split(weights)
    notes = header["__metadata__"]
    changed = st.one_of(
        damaged_json(json.loads(notes["config"])).map(lambda text: notes | {"config": text}),
        damaged_json(json.loads(notes["about"])).map(lambda text: notes | {"about": text}),
    ).filter(lambda metadata: all("\ud800" not in text for text in metadata.values()))

    def read(metadata: dict[str, str]) -> None:
        found = load_evaluator(with_metadata(tmp_path / "e.safetensors", header, rest, metadata))
        assert [type(width) for width in found.widths] == [int] * 3

    fuzz(read, changed, examples)


@pytest.mark.slow
@many
def test_nothing_said_of_lessons_does(examples, data, tmp_path):
    right = json.loads((data / ABOUT).read_text())

    def read(text: str) -> None:
        (tmp_path / ABOUT).write_text(text, encoding="utf-8")
        gripper_of(tmp_path)

    fuzz(read, damaged_json(right), examples)


def test_each_trial_is_seen_in_its_own_grid():
    one, other = lesson(1, 6), lesson(2, 6)
    apart = [seen_of([(each, PANDA)], WORKSPACE) for each in (one, other)]
    together = seen_of([(joined([one, other]), PANDA)], WORKSPACE)
    assert torch.equal(together.box, torch.cat([each.box for each in apart]))
    assert together.success.tolist() == [*one.success, *other.success]


@pytest.mark.slow
def test_stopped_and_resumed_equals_never_stopped(data, tmp_path):
    whole = train_evaluator(EvaluatorRun(data=(data,), out=tmp_path / "whole", config=TINY))
    parts = EvaluatorRun(data=(data,), out=tmp_path / "parts", config=TINY, resume=True)
    for stop in (3, 6):
        same = train_evaluator(parts, stop_after=stop)
    first, second = load_file(whole), load_file(same)
    assert all(torch.equal(first[name], second[name]) for name in first)
    logs = [(weights.parent / "log.jsonl").read_text() for weights in (whole, same)]
    assert logs[0] == logs[1]
    with pytest.raises(InputError, match="add --resume"):
        train_evaluator(replace(parts, resume=False))
    with pytest.raises(InputError, match="other values of batch"):
        train_evaluator(replace(parts, config=replace(TINY, batch=8)))
    changed = shutil.copytree(data, tmp_path / "again" / data.name)
    write_lesson(sorted(changed.glob("*.npz"))[0], lesson(99, count=41))
    with pytest.raises(InputError, match="other values of data"):
        train_evaluator(replace(parts, data=(changed,)))


@pytest.mark.slow
def test_it_learns_where_a_ball_is_held(data, tmp_path):
    config = replace(TINY, steps=150, batch=64, checkpoint_every=150)
    weights = train_evaluator(EvaluatorRun(data=(data,), out=tmp_path, config=config))
    scores = load_evaluator(weights).about["scores"]
    assert scores["auc"] > 0.9
    table = reliability_table(weights)
    assert "auc_free" in table
    assert sum(value for name, value in scores.items() if name.endswith("trials")) == 40


def test_the_reliability_curve_of_one_who_knows_nothing(data):
    seen = seen_of([(read_lesson(file), PANDA) for file in sorted(data.glob("*.npz"))], WORKSPACE)

    class Half(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.anywhere = torch.nn.Parameter(torch.zeros(1))

        def symmetric(self, box, of_up, hand):
            return torch.zeros(len(box))

    scores = judgement(Half(), seen)
    held = float(seen.success.mean())
    assert scores["auc"] == 0.5
    assert scores["from 0.5 held"] == pytest.approx(held)
    assert scores["calibration_error"] == pytest.approx(abs(0.5 - held))


def test_no_lessons_no_training(tmp_path):
    with pytest.raises(InputError, match="0 lessons"):
        train_evaluator(EvaluatorRun(data=(tmp_path,), out=tmp_path / "out", config=TINY))


@pytest.mark.slow
def test_one_evaluator_learns_what_each_of_two_grippers_holds(data, tmp_path):
    """The same balls; one gripper holds them where the other has let go."""
    wide = write_lessons(tmp_path / "wide", 12, "robotiq_2f85", near=0.012)
    config = replace(TINY, steps=800, batch=64, checkpoint_every=800)
    weights = train_evaluator(EvaluatorRun(data=(data, wide), out=tmp_path / "out", config=config))
    found = load_evaluator(weights)
    assert found.about["grippers"] == ["panda", "robotiq_2f85"]
    files, said = sorted(data.glob("*.npz")), []
    for gripper in (PANDA, Gripper.load("robotiq_2f85")):
        seen = seen_of([(read_lesson(file), gripper) for file in files], WORKSPACE)
        said.append(probabilities(found.model(), seen))
    middling = np.concatenate([_between(read_lesson(file), 0.015, 0.026) for file in files])
    assert middling.sum() > 50
    assert said[0][middling].mean() > said[1][middling].mean() + 0.4


def _between(of: Lesson, near: float, far: float) -> np.ndarray:
    """Which trials were between so many metres from the ball's middle."""
    places = WORKSPACE.voxel_centres()
    centre = places[(of.grids[0] < -0.6) & (places[..., 2] > 0.06)].mean(axis=0)
    away = np.linalg.norm((of.positions - centre)[:, :2], axis=1)
    return (away > near) & (away < far)


def test_lessons_say_what_gripper_tried(data, tmp_path):
    assert gripper_of(data).to_dict() == PANDA.to_dict()
    write_lesson(tmp_path / "ball-05.npz", lesson(5))
    with pytest.raises(InputError, match=r"lessons\.json"):
        train_evaluator(EvaluatorRun(data=(data, tmp_path), out=tmp_path / "out", config=TINY))
    about = json.loads((data / ABOUT).read_text())
    about["gripper"]["max_opening"] = -1
    (tmp_path / ABOUT).write_text(json.dumps(about))
    with pytest.raises(InputError, match=r"lessons\.json: gripper\.max_opening is -1"):
        gripper_of(tmp_path)


def test_a_damaged_evaluator_is_named(data, tmp_path):
    weights = train_evaluator(EvaluatorRun(data=(data,), out=tmp_path, config=replace(TINY, steps=1)))
    with pytest.raises(InputError, match="neither a file nor"):
        load_evaluator(tmp_path / "nobody.safetensors")
    tensors = load_file(weights)
    save_file(tensors, tmp_path / "foreign.safetensors", {"format": "neugrasp-weights", "version": "1"})
    with pytest.raises(InputError, match="not an evaluator of grasps"):
        load_evaluator(tmp_path / "foreign.safetensors")
