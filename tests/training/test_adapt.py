"""Learning from scenes of a real cell: photos and tried grasps, no truth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from ball_record import ball_record
from neugrasp.data.captures import write_capture
from neugrasp.data.records import write_record
from neugrasp.data.scene_folder import write_scene
from neugrasp.data.scene_sets import open_scenes
from neugrasp.errors import InputError
from neugrasp.observation import Views
from neugrasp.training.command import Train
from neugrasp.training.config import TrainConfig
from neugrasp.training.dataset import Scenes
from neugrasp.training.prepared import lent
from neugrasp.training.recipes import adapt, configured, tiny
from neugrasp.training.split import split
from neugrasp.training.trainer import train


def capture(folder: Path, seed: int, with_targets: bool = False) -> None:
    """Six photos of a ball, and grasps tried at it."""
    record = ball_record(x=0.1 + 0.02 * seed, y=0.14, seed=seed)
    inputs, targets = record.views(), record.target_views()
    if with_targets:
        write_capture(folder, inputs, record.labels)
        write_scene(folder / "targets", targets)
    else:
        write_capture(folder, Views((*inputs.frames, *targets.frames), inputs.workspace), record.labels)


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    for seed in range(5):
        capture(tmp_path / "cell" / f"{seed}", seed)
    return tmp_path / "cell"


@pytest.fixture
def start(tmp_path: Path, cell: Path) -> Path:
    """Weights of `tiny`, hardly trained."""
    record = ball_record()
    write_record(tmp_path / "sim" / record.name, record)
    run = Train(
        recipe="tiny", data=(tmp_path / "sim",), validation=(tmp_path / "sim",), out=tmp_path / "start"
    )
    return train(replace(run, steps=2, loaders=0))


def course(**changes: object) -> TrainConfig:
    """`adapt` at the size of `tiny`."""
    small = tiny()
    return replace(
        adapt(), model=small.model, bfloat16=False, rays=48, carving_rays=16, steps=8, validate_every=1,
        validation_scenes=2, patience=2, checkpoint_every=3, **changes,
    )  # fmt: skip


@pytest.mark.parametrize("count", [2, 3, 5, 6, 7, 8])
def test_lent_views_are_compared_with_and_never_seen(count: int):
    views = tuple(range(count))
    groups = [lent(views, np.random.default_rng(seed)) for seed in range(40)]  # type: ignore[arg-type]
    for inputs, targets in [*groups, lent(views, None)]:  # type: ignore[arg-type]
        assert sorted((*inputs, *targets)) == list(views)
        assert min(len(inputs), len(targets)) == (count // 2 if count >= 6 else 1)
    assert {view for _, targets in groups for view in targets} == set(views)
    assert lent(views, None) == lent(views, None)  # type: ignore[arg-type]


def test_two_groups_of_four_are_the_papers(cell: Path):
    views = tuple(range(8))
    found = {lent(views, np.random.default_rng(seed)) for seed in range(20)}  # type: ignore[arg-type]
    assert found == {((0, 1, 2, 3), (4, 5, 6, 7)), ((4, 5, 6, 7), (0, 1, 2, 3))}


def test_a_sample_is_that_of_the_simulators_record_without_the_truth(tmp_path: Path):
    record = ball_record(x=0.1, y=0.14)
    write_record(tmp_path / "sim" / record.name, record)
    capture(tmp_path / "cell" / record.name, 0, with_targets=True)
    samples = []
    for name in ("sim", "cell"):
        scenes = Scenes([(open_scenes(tmp_path / name), 0)], 64, finds_changes=True)
        samples.append(scenes.sample(0, np.random.default_rng(4)))
    ours, theirs = samples
    assert theirs.truth.tsdf is None
    assert theirs.truth.distance is None
    for group in ("inputs", "targets"):
        one, other = getattr(ours, group), getattr(theirs, group)
        assert torch.equal(one.views.images, other.views.images)
        assert torch.equal(one.changes, other.changes)
        torch.testing.assert_close(one.views.cameras.intrinsics, other.views.cameras.intrinsics)
    assert torch.equal(ours.truth.labels.index, theirs.truth.labels.index)


def test_the_last_scenes_are_kept_aside(cell: Path):
    scenes = open_scenes(cell)
    places = [(scenes, index) for index in range(len(scenes))]
    trained, held = split([places, places[:1]], adapt())
    assert [at for _, at in trained] == [0, 1, 2, 3, 0]
    assert [at for _, at in held] == [4]


@pytest.mark.slow
def test_it_ends_early_with_the_best_weights_and_goes_on_as_if_never_stopped(
    cell: Path, start: Path, tmp_path: Path
):
    run = Train(recipe="adapt", init=str(start), data=(cell,), out=tmp_path / "whole", loaders=0)
    # A rate that ruins the weights, so that the first validation is the best.
    config = course(optimiser=replace(adapt().optimiser, learning_rate=0.3, average=0.0))
    weights = load_file(train(run, config=config))
    lines = [json.loads(line) for line in (tmp_path / "whole" / "log.jsonl").read_text().splitlines()]
    losses = [line["validation"]["grasp_loss"] for line in lines if "validation" in line]
    best = int(np.argmin(losses))
    assert len(losses) == min(best + 1 + config.patience, config.steps)
    assert len(losses) < config.steps

    other = replace(run, out=tmp_path / "stopped")
    train(other, stop_after=1, config=config)
    resumed = load_file(train(replace(other, resume=True), config=config))
    assert all(torch.equal(weights[name], resumed[name]) for name in weights)
    after = (tmp_path / "stopped" / "log.jsonl").read_text()
    train(replace(other, resume=True), config=config)
    assert (tmp_path / "stopped" / "log.jsonl").read_text() == after


def test_recipes_that_need_truth_are_refused_by_name(cell: Path, tmp_path: Path):
    run = Train(recipe="tiny", data=(cell,), out=tmp_path / "out", loaders=0)
    with pytest.raises(InputError, match=r"no scene has a known surface, and recipe tiny .* adapt"):
        train(run)
    with pytest.raises(InputError, match="recipe adapt goes on from trained weights"):
        configured(replace(run, recipe="adapt"))


@pytest.mark.slow
def test_one_scene_leaves_none_to_keep_aside(tmp_path: Path, start: Path):
    capture(tmp_path / "single" / "0", 0)
    run = Train(recipe="adapt", init=str(start), data=(tmp_path / "single",), out=tmp_path / "out", loaders=0)
    with pytest.raises(InputError, match="1 leave none; give two or more"):
        train(run, config=course())


@pytest.mark.slow
def test_real_and_simulated_scenes_are_learned_from_together(cell: Path, start: Path, tmp_path: Path):
    """The head rehearses on the grids of those scenes that have one."""
    run = Train(recipe="tiny", data=(cell, tmp_path / "sim"), out=tmp_path / "out", steps=4, loaders=0)
    config = replace(tiny(), steps=4, head_steps=2)
    assert config.weights.rehearsal
    assert train(run, config=config).is_file()
