"""What a CPU computes, a CUDA device computes too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from ball_record import ball_record
from neugrasp.data.records import write_record
from neugrasp.data.scene_folder import read_scene
from neugrasp.data.scene_sets import SceneFolder
from neugrasp.demo.bundled import demo_scenes
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.model.network import NeuGrasp
from neugrasp.training.command import Train
from neugrasp.training.dataset import Batch, Scenes, Steps
from neugrasp.training.module import TrainingModule, neugrasp_losses
from neugrasp.training.recipes import RECIPES, recipe
from neugrasp.training.trainer import train

pytestmark = pytest.mark.gpu


@pytest.fixture(autouse=True)
def _no_tf32(monkeypatch: pytest.MonkeyPatch) -> None:
    """Convolutions in full float32, as on a CPU; TF32 moves signed distances by up to 0.003."""
    monkeypatch.setattr(torch.backends.cudnn, "allow_tf32", False)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two balls, with their distance."""
    folder = tmp_path_factory.mktemp("balls")
    for seed in range(2):
        record = ball_record(x=0.12 + 0.05 * seed, seed=seed)
        write_record(folder / "scenes" / record.name, replace(record, distance=record.tsdf))
    return folder


@pytest.fixture
def batch(data: Path) -> Batch:
    """The first joint step of the recipe tiny."""
    folder = SceneFolder(data)
    scenes = Scenes([(folder, 0), (folder, 1)], 64, finds_changes=True)
    config = recipe("tiny")
    return Steps(scenes, config)[config.head_steps]


@pytest.mark.parametrize("scene", demo_scenes(), ids=lambda scene: scene.name)
def test_grasps_are_those_of_the_cpu(scene):
    views = read_scene(scene.folder)
    here, there = (NeuGraspDetector.load(device=device).detect(views) for device in ("cpu", "cuda"))
    assert np.abs(here.tsdf - there.tsdf).max() < 2e-3
    assert len(here.grasps) == len(there.grasps)
    for ours, theirs in zip(here.grasps, there.grasps, strict=True):
        assert np.linalg.norm(ours.position - theirs.position) < 1e-3
        assert abs(ours.score - theirs.score) < 2e-3


def losses_and_gradient(config, batch: Batch, device: str) -> tuple[dict[str, float], torch.Tensor]:
    torch.manual_seed(0)
    module = TrainingModule(NeuGrasp(config.model), neugrasp_losses, config).to(device)
    losses = module(batch.to(device), config.head_steps)
    losses["loss"].backward()
    gradients = [p.grad.flatten().cpu() for p in module.parameters() if p.grad is not None]
    return {name: float(value.detach()) for name, value in losses.items()}, torch.cat(gradients)


@pytest.mark.parametrize("name", ["small", "paper", "tsdf", "geometry", "sim", "without-backgrounds"])
def test_losses_and_gradients_are_those_of_the_cpu(batch: Batch, name: str):
    config = replace(RECIPES[name](), model=recipe("tiny").model, bfloat16=False, rays=48, head_steps=0)
    if name == "without-backgrounds":
        config = replace(config, model=replace(config.model, use_backgrounds=False))
    (here, gradient), (there, same) = (
        losses_and_gradient(config, batch, device) for device in ("cpu", "cuda")
    )
    assert here == pytest.approx(there, rel=2e-3, abs=1e-5)
    assert float((gradient - same).norm() / gradient.norm()) < 2e-2


@pytest.mark.parametrize("name", ["tiny", "geometry", "sim"])
def test_a_run_with_both_stages_learns_and_resumes(data: Path, tmp_path: Path, monkeypatch, name: str):
    config = replace(
        RECIPES[name](), model=recipe("tiny").model, bfloat16=True, head_steps=0 if name == "geometry" else 2,
        head_batch=2, batch=2, steps=6, rays=48, checkpoint_every=2, validate_every=3, validation_scenes=1,
    )  # fmt: skip
    monkeypatch.setitem(RECIPES, "short", lambda: config)
    run = Train(recipe="short", data=(data,), validation=(data,), out=tmp_path / "out", device="cuda")
    train(run, stop_after=4)
    assert train(replace(run, resume=True)).is_file()
