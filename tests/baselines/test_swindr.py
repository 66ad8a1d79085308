"""SwinDR: what restoring must leave alone, what is symmetric, and that it learns by the one trainer."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from torch import nn

from ball_record import ball_record
from neugrasp.baselines.swindr import detector as swindr_detector
from neugrasp.baselines.swindr.config import SwinConfig
from neugrasp.baselines.swindr.detector import SPEC, SwinDrDetector
from neugrasp.baselines.swindr.losses import depth_loss, known_pixels
from neugrasp.baselines.swindr.network import Fusion, SwinDR, restored
from neugrasp.baselines.swindr.recipes import swindr, tiny
from neugrasp.baselines.swindr.swin import WindowAttention
from neugrasp.data.records import read_record, write_record
from neugrasp.detection.contract import Detection
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import DetectorSpec
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.run import evaluate
from neugrasp.geometry.pose import from_rotation_vector
from neugrasp.geometry.sampling import CameraTensors
from neugrasp.geometry.workspace import USUAL
from neugrasp.grasp import Grasps
from neugrasp.gripper import Gripper
from neugrasp.model.checkpoint import save_checkpoint
from neugrasp.model.compute import Compute
from neugrasp.observation import Observation, with_depth
from neugrasp.training.command import Train
from neugrasp.training.trainer import train

GOLDEN = Path(__file__).parent.parent / "golden" / "swindr_tiny_losses.json"
NETWORK = "neugrasp.baselines.swindr.losses:NETWORK"


def stereo_record(seed: int = 0, size: int = 64):
    """The ball; a sensor measured the table well, the ball in part and 3 cm too deep."""
    record = ball_record(size=size, seed=seed)
    rng = np.random.default_rng(seed)
    on_ball = np.abs(record.images.astype(int)[..., 0] - record.images.astype(int)[..., 1]) > 60
    wrong = np.where(on_ball & (rng.random(on_ball.shape) < 0.5), 0, record.depths + 0.03 * on_ball)
    measured = np.where(record.depths < 2, wrong, 0).astype(np.float32)
    return replace(record, stereo=measured, masks=on_ball.astype(np.int8))


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for seed in range(2):
        record = stereo_record(seed)
        write_record(tmp_path / "data" / "scenes" / record.name, record)
    return tmp_path / "data"


def quick(**changes: object):
    """`tiny` under the name that is known without an installation."""
    return replace(tiny(), network=NETWORK, **changes)


def images(num: int = 2, size: int = 32) -> torch.Tensor:
    return torch.rand((num, size, size), generator=torch.Generator().manual_seed(0)) * 0.5 + 0.25


def test_perfect_depth_that_is_trusted_stays_as_it_is():
    measured, initial = images(), images().flip(0)
    logits = torch.stack([torch.full_like(measured, 200.0), torch.full_like(measured, -200.0)], 1)
    assert torch.equal(restored(measured, initial, logits).depth, measured)


def test_what_was_not_measured_comes_from_the_network_alone():
    measured, initial = images(), images().flip(0)
    measured[:, ::2] = 0
    found = restored(measured, initial, torch.full((2, 2, 32, 32), 3.0))
    assert torch.equal(found.depth[:, ::2], initial[:, ::2])
    assert (found.trust[:, ::2] == 0).all()
    assert torch.equal(found.initial, initial)


def test_restored_depth_lies_between_the_two():
    measured, initial = images(), images().flip(0)
    found = restored(measured, initial, torch.randn(2, 2, 32, 32)).depth
    low, high = torch.minimum(measured, initial), torch.maximum(measured, initial)
    assert ((found >= low - 1e-6) & (found <= high + 1e-6)).all()


def test_photo_and_depth_change_places_in_the_fusion():
    """With the halves of its weights exchanged, and its maps, the joined map is the same."""
    torch.manual_seed(0)
    one, other = Fusion(8, 4), Fusion(8, 4)
    state = {
        name.replace(".0.", ".x.").replace(".1.", ".0.").replace(".x.", ".1."): value
        for name, value in one.state_dict().items()
        if name.split(".")[0] in ("normals", "attentions", "between")
    }
    for name, value in one.state_dict().items():
        if name.startswith("perceptrons."):
            kind, index, rest = name.split(".", 2)
            state[f"{kind}.{1 - int(index)}.{rest}"] = value
        elif name.startswith(("joined", "normal.")):
            halves = value.chunk(2, 1)[::-1] if name == "joined.weight" else (value,)
            state[name] = torch.cat(halves, 1) if len(halves) == 2 else value
    other.load_state_dict(state)
    a, b = torch.randn(2, 8, 8, 8), torch.randn(2, 8, 8, 8)
    straight, crossed = one(a, b), other(b, a)
    torch.testing.assert_close(straight[..., 16:], crossed[..., 16:])
    torch.testing.assert_close(straight[..., :8], crossed[..., 8:16])


def test_windows_hear_nothing_from_one_another():
    attention = WindowAttention(8, 2, 4).eval()
    asking = torch.randn(1, 8, 8, 8)
    changed = asking.clone()
    changed[:, :4, :4] += 1
    difference = (attention(asking, asking) - attention(changed, changed)).abs().amax(-1)[0]
    assert (difference[:4, :4] > 0).all()
    assert difference[4:].max() == 0
    assert difference[:, 4:].max() == 0


def test_shifted_windows_do_not_reach_around_the_edge():
    attention = WindowAttention(8, 2, 4, shift=2).eval()
    asking = torch.randn(1, 8, 8, 8)
    changed = asking.clone()
    changed[:, 0, 0] += 1
    difference = (attention(asking, asking) - attention(changed, changed)).abs().amax(-1)[0]
    assert (difference[:2, :2] > 0).all()
    assert difference[2:].max() == 0
    assert difference[:, 2:].max() == 0


def test_the_loss_is_0_for_the_truth_and_counts_only_what_is_known():
    record = stereo_record()
    cameras = CameraTensors.of(list(record.cameras))
    truth = torch.from_numpy(record.depths)
    known, objects = known_pixels(truth, cameras), torch.from_numpy(record.masks > 0)
    assert depth_loss(truth, truth, known, objects, cameras) == 0
    elsewhere = torch.where(known, truth, truth + 1)
    inner = known & (nn.functional.max_pool2d((~known).float(), 3, 1, 1) == 0)
    assert depth_loss(elsewhere, truth, inner, objects, cameras) == 0
    tilted = truth + 0.1 * torch.linspace(0, 1, truth.shape[-1])
    assert depth_loss(tilted, truth, known, objects, cameras) > 0.05


def test_the_network_is_as_small_as_it_says():
    network = SwinDR(SwinConfig(), USUAL)
    assert sum(one.numel() for one in network.parameters()) == pytest.approx(4.6e6, rel=0.01)


def losses_of(out: Path) -> list[float]:
    lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    return [line["loss"] for line in lines if "loss" in line]


@pytest.mark.slow
def test_it_learns_goes_on_and_follows_the_golden_curve(data: Path, tmp_path: Path):
    whole = Train(recipe="swindr-tiny", data=(data,), validation=(data,), out=tmp_path / "whole", loaders=0)
    first = load_file(train(whole, config=quick()))
    parts = replace(whole, out=tmp_path / "parts", resume=True)
    for stop in (3, 6):
        second = load_file(train(parts, stop_after=stop, config=quick()))
    assert all(torch.equal(first[name], second[name]) for name in first)
    assert losses_of(whole.out) == losses_of(parts.out)
    assert losses_of(whole.out) == pytest.approx(json.loads(GOLDEN.read_text()), rel=1e-5)
    scores = json.loads((whole.out / "log.jsonl").read_text().splitlines()[-1])["validation"]
    assert scores["measured_objects_mm"] == pytest.approx(30, abs=1)
    assert {"restored_objects_mm", "restored_background_close"} <= scores.keys()
    assert (whole.out / "progress_000006.png").is_file()


def test_scenes_without_a_stereo_sensor_are_refused(tmp_path: Path):
    record = ball_record()
    write_record(tmp_path / "data" / "scenes" / record.name, record)
    run = Train(recipe="swindr-tiny", data=(tmp_path / "data",), out=tmp_path / "out", loaders=0)
    with pytest.raises(InputError, match=r"ball-0: holds no depth of a stereo sensor.*generate --stereo"):
        train(run, config=quick())


def test_measured_depth_is_kept_with_the_record(tmp_path: Path):
    record = stereo_record()
    write_record(tmp_path / "one", record)
    found = read_record(tmp_path / "one")
    assert found.stereo is not None
    np.testing.assert_allclose(found.stereo, record.stereo, atol=6e-5)
    assert read_record(tmp_path / "one", photos="none").stereo is None


class Remembers:
    """Takes VGN's place."""

    def __init__(self, *_: object):
        self.seen: list[Observation] = []

    def detect(self, seen: Observation) -> Detection:
        self.seen.append(seen)
        return Detection(Grasps.of(()), seen.workspace, Gripper.load("panda"), timing_s={"fuse": 1.0})


class Trusts(nn.Module):
    """A network that believes all that was measured."""

    def __init__(self):
        super().__init__()
        self.config = SwinConfig(image_size=64)

    def forward(self, photos: torch.Tensor, measured: torch.Tensor):
        logits = torch.tensor([200.0, -200.0])[None, :, None, None].expand(len(photos), 2, 64, 64)
        return restored(measured, torch.full_like(measured, 0.5), logits)


def test_trusted_depth_reaches_vgn_unchanged_where_the_user_has_the_table():
    record = ball_record(size=64)
    placed = from_rotation_vector((0.1, 0.2, 0.3), (1.0, 2.0, 3.0))
    frames = tuple(
        replace(view, camera=view.camera.moved(placed), depth=depth)
        for view, depth in zip(record.views().frames, record.depths, strict=True)
    )
    seen = Observation(frames, replace(USUAL, world_from_workspace=placed))
    vgn = Remembers()
    found = SwinDrDetector(Trusts(), vgn, Compute.of("cpu")).detect(seen)  # type: ignore[arg-type]
    assert set(found.timing_s) == {"restore", "fuse"}
    for frame, exact in zip(with_depth(vgn.seen[0]).frames, frames, strict=True):
        np.testing.assert_allclose(frame.camera.world_from_camera, exact.camera.world_from_camera, atol=1e-12)
        inside = frame.depth > 0
        np.testing.assert_array_equal(frame.depth[inside], exact.depth[inside])
        _, top, _, _ = exact.camera.bounds
        assert not frame.depth[: max(0, int(np.ceil(top)))].any()
        assert inside.mean() > 0.5


@pytest.mark.slow
def test_it_plays_a_round_on_stereo_depth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("NEUGRASP_CACHE", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(Path(__file__).parent.parent / "simulation")
    scene_renderer = importlib.import_module("noise_renderer").NoiseRenderer
    vgn = Remembers()
    facts = lambda options: {"weights": "vgn", "weights_sha256": "0", "threshold": 0.9}  # noqa: E731
    monkeypatch.setattr(
        swindr_detector, "VGN", DetectorSpec(frozenset({"depth"}), lambda options: vgn, facts)
    )
    weights = tmp_path / "swindr.safetensors"
    save_checkpoint(weights, SwinDR(tiny().model, USUAL), {"recipe": "swindr"}, network="swindr")
    game = Evaluate(
        out=tmp_path / "rounds",
        detector="neugrasp.baselines.swindr.detector:SPEC",
        restorer=str(weights),
        depth="stereo",
        scene="single",
        rounds=1,
        workers=1,
        seed=31,
    )
    told = evaluate(game, scene_renderer)
    assert told["restorer"] == weights.name
    assert told["depth"] == "stereo"
    assert len(vgn.seen) == 1
    assert all(frame.depth.shape == (64, 64) for frame in with_depth(vgn.seen[0]).frames)


def test_missing_and_foreign_weights_are_named(tmp_path: Path):
    with pytest.raises(InputError, match="neugrasp train --recipe swindr"):
        SPEC.load(DetectorOptions(restorer=str(tmp_path / "none.safetensors")))
    with pytest.raises(InputError, match="weights of the network 'neugrasp', not 'swindr'"):
        SPEC.load(DetectorOptions(restorer="neugrasp"))


def test_the_recipe_reads_depth_and_no_change():
    assert swindr().weights.depth
    assert not swindr().weights.finds_changes
