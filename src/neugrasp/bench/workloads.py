"""What is measured: bundled photos, a network, and a training sample made of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from neugrasp.change_mask import change_labels
from neugrasp.data.scene_folder import read_scene
from neugrasp.demo.bundled import demo_scenes
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.gripper import Gripper
from neugrasp.model.config import ModelConfig, NetworkConfig
from neugrasp.model.inputs import prepare
from neugrasp.model.network import NeuGrasp
from neugrasp.observation import Views
from neugrasp.training.config import TrainConfig
from neugrasp.training.recipes import paper, small
from neugrasp.training.samples import LabelTensors, Photos, Sample, Truth

NUM_TARGETS = 2
"""Views that are rendered against, as generated records have them."""
NUM_GRASPS = 120
"""Labelled grasps of a scene: as many as the generator tries points."""


def shaped_detector(shape: str, seed: int, device: torch.device) -> NeuGraspDetector:
    """The shipped network, or one of the paper's shapes at random weights."""
    if shape == "small":
        return NeuGraspDetector.load(device=device)
    return NeuGraspDetector(fresh_model(paper().model, seed), Gripper.load("panda"), device=device)


def shaped_training(shape: str, model: NeuGrasp) -> TrainConfig:
    """The recipe of a shape with every step alike: it drops no views."""
    recipe = small() if shape == "small" else paper()
    return replace(recipe, model=model.config, view_dropout=0.0)


def fresh_model(config: NetworkConfig, seed: int) -> NeuGrasp:
    """A network at the random weights of a seed; the global generator is left as it was."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        assert isinstance(config, ModelConfig)
        return NeuGrasp(config)


def bundled_folder() -> Path:
    """The first bundled scene."""
    return demo_scenes()[0].folder


def bundled_views(num: int) -> Views:
    """The first bundled scene with `num` views; beyond its own four they come again."""
    views = read_scene(bundled_folder())
    return replace(views, frames=tuple(views.frames[i % len(views)] for i in range(num)))


def training_sample(views: Views, size: int, seed: int) -> Sample:
    """The scene as a step sees it: photos to look at and to render against, and random grasps."""
    rng = np.random.default_rng(seed)
    inputs = _photos(views, size)
    targets = replace(views, frames=tuple(views.frames[i % len(views)] for i in range(NUM_TARGETS)))
    resolution = views.workspace.resolution
    labels = LabelTensors(
        torch.from_numpy(rng.integers(0, resolution, (NUM_GRASPS, 3))),
        torch.nn.functional.normalize(torch.from_numpy(rng.normal(size=(NUM_GRASPS, 4))).float(), dim=1),
        torch.from_numpy(rng.uniform(2, 10, NUM_GRASPS)).float(),
        torch.from_numpy(rng.random(NUM_GRASPS) < 0.5),
    )
    grid = (resolution,) * 3
    truth = Truth(labels, torch.ones(grid), torch.ones(grid, dtype=torch.bool))
    return Sample(inputs, _photos(targets, size), truth)


def _photos(views: Views, size: int) -> Photos:
    prepared = prepare(views, size)
    pairs = [
        _as_bytes(image, empty) for image, empty in zip(prepared.images, prepared.backgrounds, strict=True)
    ]
    return Photos(prepared, torch.from_numpy(np.stack([change_labels(*pair) for pair in pairs])))


def _as_bytes(*photos: torch.Tensor) -> list[np.ndarray]:
    return [(photo * 255).round().byte().permute(1, 2, 0).numpy() for photo in photos]
