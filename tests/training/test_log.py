"""Losses go where the run says, and steps that are repeated replace those of before."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from neugrasp import cli
from neugrasp.errors import InputError
from neugrasp.training.command import Train
from neugrasp.training.log import TrainingLog
from neugrasp.training.recipes import configured, recipe


def lines(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]


def test_repeated_steps_replace_those_of_before(tmp_path: Path):
    log = TrainingLog(tmp_path, 0)
    for step in range(3):
        log.step(step, {"loss": 1.0 + step}, 1e-3)
    log.validation(3, {"iou": 0.5})
    log.close()
    log = TrainingLog(tmp_path, 2)
    log.step(2, {"loss": 9.0}, 1e-3)
    log.close()
    assert [line["loss"] for line in lines(tmp_path)] == [1.0, 2.0, 9.0]


def test_tensorboard_only_where_it_is_asked_for(tmp_path: Path):
    for names in ((), ("tensorboard",)):
        log = TrainingLog(tmp_path, 0, names)
        log.step(0, {"loss": 1.0}, 1e-3)
        log.close()
        assert (tmp_path / "tensorboard").is_dir() == bool(names)


def test_weights_and_biases_get_the_configuration_and_the_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    told: list[Any] = []
    run = SimpleNamespace(
        log=lambda numbers, step: told.append((step, numbers)), finish=lambda: told.append("end")
    )
    monkeypatch.setitem(sys.modules, "wandb", SimpleNamespace(init=lambda **facts: told.append(facts) or run))
    log = TrainingLog(tmp_path, 0, ("wandb",), {"steps": 7})
    log.step(0, {"loss": 2.0}, 1e-3)
    log.validation(1, {"iou": 0.5})
    log.close()
    assert told[0]["config"] == {"steps": 7}
    assert (told[0]["id"], told[0]["resume"]) == (tmp_path.name, "allow")
    assert told[1:] == [
        (0, {"train/loss": 2.0, "train/learning_rate": 1e-3}), (0, {"validation/iou": 0.5}), "end",
    ]  # fmt: skip


def test_a_logger_that_is_not_installed_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(InputError, match="--loggers wandb: pip install wandb"):
        TrainingLog(tmp_path, 0, ("wandb",))


def test_every_value_of_a_recipe_is_an_option(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    got: list[Any] = []
    monkeypatch.setattr("neugrasp.training.trainer.run", lambda *both: got.append(both))
    words = ["train", "--recipe", "tiny", "--data", "d", "--out", str(tmp_path), "--steps", "24"]
    assert cli.main(words) == 0
    assert cli.main([*words, "--optimiser.learning-rate", "3e-4", "--weights.eikonal", "0.2"]) == 0
    (options, plain), (again, changed) = got
    assert options == again == Train(recipe="tiny", data=(Path("d"),), out=tmp_path, steps=24)
    assert plain == configured(options)
    assert (plain.steps, plain.head_steps) == (24, 2 * recipe("tiny").head_steps)
    assert (changed.optimiser.learning_rate, changed.weights.eikonal) == (3e-4, 0.2)
    assert changed.optimiser.head_learning_rate == plain.optimiser.head_learning_rate
    with pytest.raises(SystemExit):
        cli.main([*words, "--optimiser.learning-rat", "3e-4"])


def test_a_precision_of_ones_own(tmp_path: Path):
    run = Train(recipe="small", data=(), out=tmp_path, precision="float32")
    assert (configured(run).bfloat16, recipe("small").bfloat16) == (False, True)
