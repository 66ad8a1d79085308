"""A VGN of our own: trained by the one loop on fused grids, read by the detector where its voxels lie."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from ball_record import ball_record
from neugrasp.baselines.vgn import VgnDetector, VgnHead, vgn_selection
from neugrasp.baselines.vgn_training import NAME, Vgn, VgnConfig, vgn
from neugrasp.data.records import read_record, without_photos, write_record
from neugrasp.detection.decode import SelectionConfig
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import detector_spec
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.run import evaluate
from neugrasp.geometry.fusion import Tsdf
from neugrasp.geometry.view_sets import vgn_training
from neugrasp.geometry.workspace import USUAL
from neugrasp.gripper import Gripper
from neugrasp.model.checkpoint import save_checkpoint
from neugrasp.simulation.gt_tsdf import fused_grids
from neugrasp.training.command import Train
from neugrasp.training.config import TrainConfig
from neugrasp.training.trainer import train

SPEC = "neugrasp.baselines.vgn:SPEC"


class Ball:
    """A world with a ball, in closed form."""

    def depth_and_mask(self, camera):  # type: ignore[no-untyped-def]
        from ball_record import photo

        depth = photo(camera, (np.array([0.15, 0.15, 0.08]), 0.03))[1]
        return depth, np.zeros(depth.shape, np.int16)


def tiny(**changes: object) -> TrainConfig:
    model = VgnConfig(head_channels=(4, 8, 8))
    course = {"steps": 6, "head_steps": 6, "head_batch": 2, "checkpoint_every": 2, "validate_every": 6}
    return replace(vgn(), model=model, bfloat16=False, **course, **changes)  # type: ignore[arg-type]


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Two balls that nobody photographed, and grids of three sets of views."""
    for seed in range(2):
        record = ball_record(seed=seed)
        fused = fused_grids(Ball(), USUAL, np.random.default_rng(seed), 3)
        bare = replace(record, cell={"photos": False}, fused=fused, **without_photos())
        write_record(tmp_path / "data" / "scenes" / bare.name, bare)
    return tmp_path / "data"


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    torch.manual_seed(0)
    path = tmp_path / "vgn.safetensors"
    save_checkpoint(
        path, Vgn(VgnConfig(head_channels=(4, 8, 8))), {"recipe": NAME, "threshold": 0.4}, False, NAME
    )
    return path


def test_views_of_vgns_training_look_at_the_floor_from_above():
    rng, floor = np.random.default_rng(0), USUAL.centre * (1, 1, 0)
    counts = set()
    for _ in range(60):
        cameras = vgn_training(USUAL, rng)
        counts.add(len(cameras))
        for camera in cameras:
            offset = camera.centre - floor
            radius = np.linalg.norm(offset)
            assert 0.48 <= radius <= 0.72
            assert offset[2] >= radius * np.cos(np.pi / 4) - 1e-9
            np.testing.assert_allclose(camera.project(floor)[0], (320, 240), atol=1e-6)
    assert counts == {1, 2, 3, 4, 5, 6}


@pytest.mark.slow
def test_fused_grids_are_those_of_vgn_and_kept_with_the_record(data: Path):
    record = read_record(data / "scenes" / "ball-0")
    assert record.fused is not None
    assert record.fused.shape == (3, 40, 40, 40)
    assert record.fused.min() == 0
    assert 0.9 < record.fused.max() <= 1
    # Where a view saw the top of the ball, its surface is where the true one is.
    for grid in record.fused:
        seen = (grid > 0.4) & (grid < 0.6)
        assert np.abs(record.tsdf[seen]).mean() < 0.3


@pytest.mark.slow
def test_it_trains_goes_on_and_is_judged(data: Path, tmp_path: Path):
    run = Train(recipe=NAME, data=(data,), validation=(data,), out=tmp_path / "vgn", loaders=0)
    train(run, config=tiny(), stop_after=3)
    train(replace(run, resume=True), config=tiny())
    lines = [json.loads(line) for line in (run.out / "log.jsonl").read_text().splitlines()]
    losses = [line["loss"] for line in lines if "loss" in line]
    assert len(losses) == 6
    assert losses[-1] < losses[0]
    assert lines[-1]["validation"].keys() == {"grasp_auc", "rotation_error_deg"}


def test_scenes_without_fused_grids_are_named(tmp_path: Path):
    bare = replace(ball_record(), cell={"photos": False}, **without_photos())
    write_record(tmp_path / "data" / "scenes" / bare.name, bare)
    run = Train(recipe=NAME, data=(tmp_path / "data",), out=tmp_path / "vgn", loaders=0)
    with pytest.raises(InputError, match=r"benchmarks/add_fused\.py adds them"):
        train(run, config=tiny())


@pytest.mark.slow
def test_it_plays_a_round(weights: Path, tmp_path: Path):
    game = Evaluate(
        out=tmp_path / "rounds", detector=SPEC, weights=str(weights), scene="single", rounds=1, seed=31,
        threshold=0.0, views="hemisphere6",
    )  # fmt: skip
    told = evaluate(game)
    assert told["rounds"] == 1
    assert told["trained"] == {"recipe": NAME}
    assert "hand_check" not in told


def test_a_grasp_of_ours_lies_at_the_middle_of_its_voxel():
    """The public checkpoint's lies at its corner."""
    torch.manual_seed(0)
    network = Vgn(VgnConfig()).eval()
    torch.nn.init.constant_(network.head.width.bias, 5.0)
    height = USUAL.voxel_centres()[..., 2] - USUAL.table_height
    tsdf = Tsdf((height / USUAL.truncation).clip(-1, 1).astype(np.float32), np.ones((40, 40, 40), np.float32))
    ours, public = (
        vgn_selection(VgnHead(network, public), tsdf, USUAL, Gripper.load("panda"), SelectionConfig(0.0))[0]
        for public in (False, True)
    )
    assert len(ours.grasps) == len(public.grasps) > 0
    for one, other in zip(ours.grasps, public.grasps, strict=True):
        np.testing.assert_allclose(one.position - other.position, USUAL.voxel_size / 2, atol=1e-9)


def test_what_a_user_may_get_wrong(weights: Path, tmp_path: Path):
    spec = detector_spec(SPEC)
    detector = spec.load(DetectorOptions(weights=str(weights)))
    assert isinstance(detector, VgnDetector)
    assert detector._config.threshold == 0.4
    with pytest.raises(InputError, match="neugrasp train --recipe vgn"):
        spec.load(DetectorOptions(weights=str(tmp_path / "none.safetensors")))
    other = tmp_path / "other.safetensors"
    save_checkpoint(other, Vgn(VgnConfig()), {}, network="graspnerf")
    with pytest.raises(InputError, match="weights of the network 'graspnerf', not 'vgn'"):
        spec.load(DetectorOptions(weights=str(other)))
