"""GraspNeRF trains in the one loop, its losses do not drift, and its weights play rounds."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from ball_record import ball_record
from neugrasp.baselines.graspnerf.config import GraspNerfConfig
from neugrasp.baselines.graspnerf.detector import NAMES, WITH_TSDF, GraspNerfDetector
from neugrasp.baselines.graspnerf.network import GraspNerf
from neugrasp.data.records import write_record
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import detector_spec
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.run import evaluate
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.checkpoint import (
    load_checkpoint,
    load_network,
    notes_of,
    save_checkpoint,
    ship_checkpoint,
)
from neugrasp.observation import DepthView, Frame, Observation, Views
from neugrasp.training.command import Train
from neugrasp.training.recipes import recipe
from neugrasp.training.trainer import train

RECIPES = "neugrasp.baselines.graspnerf.recipes"
GOLDEN = Path(__file__).parent.parent / "golden" / "graspnerf_tiny_losses.json"


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for seed, (x, y) in enumerate([(0.15, 0.15), (0.1, 0.18)]):
        record = ball_record(x=x, y=y, seed=seed)
        write_record(tmp_path / "data" / "scenes" / record.name, record)
    return tmp_path / "data"


@pytest.fixture
def scene_renderer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> type:
    monkeypatch.setenv("NEUGRASP_CACHE", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(Path(__file__).parent.parent / "simulation")
    return importlib.import_module("noise_renderer").NoiseRenderer


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    """Of a network that has learned nothing, as if with TSDF."""
    torch.manual_seed(0)
    network = GraspNerf(recipe(f"{RECIPES}:tiny").model)  # type: ignore[arg-type]
    path = tmp_path / "weights.safetensors"
    save_checkpoint(path, network, {"recipe": "graspnerf-tsdf", "threshold": 0.3}, network="graspnerf")
    return path


def losses_of(out: Path) -> list[float]:
    lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    return [line["loss"] for line in lines if "loss" in line]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tiny", "tiny_without"])
def test_losses_do_not_drift_however_often_it_is_stopped(name: str, data: Path, tmp_path: Path):
    """Two stages, checkpoints between, and the loss curve that is kept with the code."""
    whole = Train(
        recipe=f"{RECIPES}:{name}", data=(data,), out=tmp_path / "whole", validation=(data,), loaders=0
    )
    weights = train(whole)
    parts = replace(whole, out=tmp_path / "parts", resume=True)
    for stop in (4, None):
        same = train(parts, stop_after=stop)
    first, second = load_file(weights), load_file(same)
    assert first.keys() == second.keys()
    assert all(torch.equal(first[key], second[key]) for key in first)
    assert losses_of(whole.out) == losses_of(parts.out)
    assert len(list(whole.out.glob("progress_*.png"))) == 1
    scores = json.loads((whole.out / "log.jsonl").read_text().splitlines()[-1])["validation"]
    assert {"l1_0.3", "iou", "psnr", "grasp_auc"} <= scores.keys()
    assert losses_of(whole.out) == pytest.approx(json.loads(GOLDEN.read_text())[name], rel=1e-5)


@pytest.mark.slow
def test_it_goes_on_from_its_own_weights_or_from_a_head(data: Path, weights: Path, tmp_path: Path):
    run = Train(recipe=f"{RECIPES}:tiny", data=(data,), out=tmp_path / "more", init=str(weights), loaders=0)
    tiny = recipe(run.recipe)
    still = replace(
        tiny, steps=1, head_steps=0, optimiser=replace(tiny.optimiser, learning_rate=0, average=0)
    )
    first, second = load_file(weights), load_file(train(run, config=still))
    assert all(torch.equal(first[key], second[key]) for key in first)
    with pytest.raises(InputError, match="configured differently from the recipe's, its head too"):
        train(replace(run, init="neugrasp", out=tmp_path / "other"), config=still)
    alike = replace(still, model=replace(still.model, head_channels=(16, 32, 64)))  # type: ignore[type-var]
    taken = load_file(train(replace(run, init="neugrasp", out=tmp_path / "head"), config=alike))
    given = load_checkpoint("neugrasp").tensors
    assert all(torch.equal(taken[key], given[key].float()) for key in given if key.startswith("head."))


@pytest.mark.slow
def test_weights_are_shipped_in_half_the_size(weights: Path, tmp_path: Path):
    shipped = tmp_path / "shipped.safetensors"
    assert ship_checkpoint(weights, shipped, 0.7) == {"recipe": "graspnerf-tsdf", "threshold": 0.7}
    assert notes_of(shipped, "graspnerf")["threshold"] == 0.7
    first, second = (
        load_network(path, "graspnerf", GraspNerfConfig, GraspNerf) for path in (weights, shipped)
    )
    assert first.config == second.config
    for one, other in zip(first.parameters(), second.parameters(), strict=True):
        torch.testing.assert_close(one, other, atol=1e-3, rtol=1e-3)


def test_weights_are_read_back(weights: Path):
    network = load_network(weights, "graspnerf", GraspNerfConfig, GraspNerf)
    assert network.config == recipe(f"{RECIPES}:tiny").model
    assert notes_of(weights, "graspnerf")["threshold"] == 0.3


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_each_plays_a_round(name: str, weights: Path, tmp_path: Path, scene_renderer: type):
    path = weights
    if name == "graspnerf":
        path = tmp_path / "without.safetensors"
        network = load_network(weights, "graspnerf", GraspNerfConfig, GraspNerf)
        save_checkpoint(path, network, {"recipe": name}, network="graspnerf")
    spec = {"graspnerf": "WITHOUT", "graspnerf-tsdf": "WITH_TSDF"}[name]
    game = Evaluate(
        out=tmp_path / "rounds",
        detector=f"neugrasp.baselines.graspnerf.detector:{spec}",
        weights=str(path),
        scene="single",
        rounds=1,
        seed=31,
        threshold=0.0,
    )
    told = evaluate(game, scene_renderer)
    assert told["rounds"] == 1
    assert told["weights"] == path.name
    assert told["trained"] == {"recipe": name}


@pytest.mark.slow
def test_the_same_photos_with_and_without_backgrounds(weights: Path, small_views: Views):
    detector = WITH_TSDF.load(DetectorOptions(weights=str(weights)))
    bare = Observation([Frame(view.camera, view.image) for view in small_views.frames], small_views.workspace)
    first, second = detector.detect(small_views), detector.detect(bare)
    np.testing.assert_array_equal(first.grid(), second.grid())
    assert first.threshold == 0.3


@pytest.mark.slow
def test_what_a_user_may_get_wrong(weights: Path, small_views: Views, tmp_path: Path):
    detector = WITH_TSDF.load(DetectorOptions(weights=str(weights)))
    assert isinstance(detector, GraspNerfDetector)
    depths = [
        DepthView(view.camera, depth=np.ones(view.image.shape[:2], np.float32)) for view in small_views.frames
    ]
    with pytest.raises(InputError, match="has depth image, and no photo"):
        detector.detect(Observation(depths, small_views.workspace))
    with pytest.raises(InputError, match="these weights were trained for"):
        detector.detect(replace(small_views, workspace=Workspace.with_edge(0.4, 40)))
    without = detector_spec("neugrasp.baselines.graspnerf.detector:WITHOUT")
    with pytest.raises(InputError, match="trained as graspnerf-tsdf, not as graspnerf; give --detector"):
        without.load(DetectorOptions(weights=str(weights)))
    shipped = detector_spec("neugrasp.detection.detector:SPEC")
    with pytest.raises(InputError, match="weights of the network 'graspnerf', not 'neugrasp'"):
        shipped.load(DetectorOptions(weights=str(weights)))
    with pytest.raises(InputError, match="neugrasp train --recipe graspnerf"):
        without.load(DetectorOptions(weights=str(tmp_path / "none.safetensors")))
