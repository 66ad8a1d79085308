"""Networks of other packages are trained by the one loop, and play rounds with what they learned."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace
from pathlib import Path

import pytest
from safetensors.torch import load_file

from ball_record import ball_record
from neugrasp.data.records import write_record
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.run import evaluate
from neugrasp.model.checkpoint import load_checkpoint
from neugrasp.model.config import NetworkConfig
from neugrasp.training.command import Train
from neugrasp.training.config import LossWeights, TrainConfig
from neugrasp.training.networks import network_spec
from neugrasp.training.recipes import RENAMED, recipe, tiny
from neugrasp.training.state import Identity
from neugrasp.training.trainer import train
from toy_network import NAME


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for seed in range(2):
        record = ball_record(seed=seed)
        write_record(tmp_path / "data" / "scenes" / record.name, record)
    return tmp_path / "data"


@pytest.fixture
def scene_renderer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> type:
    monkeypatch.setenv("NEUGRASP_CACHE", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(Path(__file__).parent.parent / "simulation")
    return importlib.import_module("noise_renderer").NoiseRenderer


def toy(**changes: object) -> TrainConfig:
    return replace(
        tiny(),
        network=NAME,
        model=NetworkConfig(),
        head_steps=0,
        validate_every=1,
        checkpoint_every=1,
        **changes,
    )


@pytest.mark.slow
def test_a_toy_network_learns_goes_on_and_plays(data: Path, tmp_path: Path, scene_renderer: type):
    run = Train(recipe="toy", data=(data,), validation=(data,), out=tmp_path / "toy", loaders=0)
    train(run, config=toy(steps=1))
    weights = train(replace(run, resume=True), config=toy(steps=2))
    assert load_file(weights)["height"] != 0.1
    scores = [json.loads(line) for line in (run.out / "log.jsonl").read_text().splitlines()]
    assert [one["validation"].keys() for one in scores if "validation" in one] == [{"height"}, {"height"}]
    with pytest.raises(InputError, match=f"weights of the network '{NAME}', not 'neugrasp'"):
        load_checkpoint(weights)
    game = Evaluate(
        out=tmp_path / "rounds", detector="toy_network:DETECTOR", weights=str(weights), rounds=1, seed=31
    )
    assert evaluate(game, scene_renderer)["attempts"] >= 1


def test_recipes_of_others():
    assert recipe("toy_network:recipe").network == NAME
    for name, words in (
        ("nothing", "unknown recipe 'nothing'; choose one of small, .*, or name yours as module:NAME"),
        ("toy_network:NAME", "gives a str, not a TrainConfig"),
        ("toy_network:ABSENT", "cannot be imported"),
    ):
        with pytest.raises(InputError, match=words):
            recipe(name)


def test_a_state_of_before_an_option_was_there_has_its_usual_value():
    """So that runs go on after an update; but not where the option now says something else."""
    facts = Identity(TrainConfig(), "data").facts()
    old = {name: fact for name, fact in facts.items() if name not in ("weights.depth", "network")}
    assert Identity(TrainConfig(), "data").differences(old) == []
    told = replace(TrainConfig(), network=NAME, weights=LossWeights(depth=1.0))
    assert Identity(told, "data").differences(old) == ["network", "weights.depth"]


@pytest.mark.parametrize(
    ("name", "words"),
    [("nowhere", "choose one of neugrasp"), ("json:loads", "is a function, not a NetworkSpec")],
)
def test_names_that_are_no_networks(name: str, words: str):
    with pytest.raises(InputError, match=words):
        network_spec(name)


def test_a_detector_and_a_network_are_fewer_than_forty_lines_each():
    for name in ("toy_detector.py", "toy_network.py"):
        assert len((Path(__file__).parent.parent / name).read_text().splitlines()) < 40


def test_an_old_name_of_a_recipe_is_read_and_said_to_be_old(caplog: pytest.LogCaptureFixture):
    for old, new in RENAMED.items():
        assert recipe(old) == recipe(new)
        assert f"recipe {old} is called {new} now" in caplog.text
