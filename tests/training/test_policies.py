"""What a run does around its losses: each of these could be taken away without a loss noticing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from neugrasp.data.records import write_record
from neugrasp.model.network import NeuGrasp
from neugrasp.training.command import Train
from neugrasp.training.prepared import PreparedView, crop_views
from neugrasp.training.recipes import RECIPES, tiny
from neugrasp.training.samples import sample_of
from neugrasp.training.state import TrainState
from neugrasp.training.trainer import train


@pytest.mark.slow
def test_what_is_shipped_is_the_moving_average(tmp_path: Path, make_record, monkeypatch: pytest.MonkeyPatch):
    optimiser = replace(tiny().optimiser, average=0.9)
    monkeypatch.setitem(RECIPES, "slow", lambda: replace(tiny(), optimiser=optimiser, checkpoint_every=1))
    record = make_record()
    write_record(tmp_path / "data" / "scenes" / record.name, record)
    run = Train(recipe="slow", data=(tmp_path / "data",), out=tmp_path / "out", steps=6, loaders=0)
    shipped, state = load_file(train(run)), load_file(tmp_path / "out" / "state.safetensors")
    for name, weights in shipped.items():
        torch.testing.assert_close(weights, state[f"average.module.{name}"])
    assert any(not torch.equal(weights, state[f"model.{name}"]) for name, weights in shipped.items())


def test_a_gradient_is_clipped_before_the_optimiser_sees_it():
    model = NeuGrasp(tiny().model)
    learner = TrainState.of(model, tiny())
    for parameter in model.parameters():
        parameter.grad = torch.full_like(parameter, 7.0)
    learner.update(gradient_clip=0.5)
    first = torch.cat([moments["exp_avg"].flatten() for moments in learner.optimizer.state.values()])
    # Adam's first moment after one step is a tenth of the gradient.
    assert float(first.norm()) == pytest.approx(0.05, rel=1e-3)


def test_photos_and_backgrounds_drift_apart_in_brightness(make_record):
    """A camera's exposure is never the same twice. The scene is empty, so all else is alike."""
    record = make_record(x=5.0)
    groups = tuple(
        tuple(PreparedView(view, np.zeros((64, 64), np.int8)) for view in group)
        for group in crop_views(record.grasp_scene(), 64)
    )
    ratios = []
    for seed in range(12):
        views = sample_of(record.grasp_scene(), groups, np.random.default_rng(seed)).inputs.views
        ratios.append(float(views.images.mean() / views.backgrounds.mean()))
    assert max(ratios) - min(ratios) > 0.008
    assert all(abs(ratio - 1) < 0.015 for ratio in ratios)
