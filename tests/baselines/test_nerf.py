"""RGBGrasp-GT: hash grids, histograms along rays, and a field that learns the depth it is told."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as F

from ball_record import ball_record
from neugrasp.baselines.nerf.detector import SPEC, NerfDetector
from neugrasp.baselines.nerf.field import FieldConfig, harmonics
from neugrasp.baselines.nerf.fit import Diverged, FitConfig, depth_error, fitted, pixels_of, rendered_depth
from neugrasp.baselines.nerf.hash_grid import HashGrid
from neugrasp.baselines.nerf.histograms import (
    depth_loss,
    distortion_loss,
    interlevel_loss,
    resampled,
    weights_of,
)
from neugrasp.detection.contract import Detection
from neugrasp.detection.options import DetectorOptions
from neugrasp.errors import InputError
from neugrasp.geometry.pose import from_rotation_vector
from neugrasp.grasp import Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Observation, with_depth

QUICK = FitConfig(steps=60, field=FieldConfig(levels=6, finest=128))
CPU = torch.device("cpu")


def seen_of(size: int = 48) -> Observation:
    record = ball_record(size=size)
    frames = zip(record.views().frames, record.depths, strict=True)
    return Observation(tuple(replace(view, depth=depth) for view, depth in frames), record.workspace)


def grid(levels: int = 3, log2_entries: int = 8) -> HashGrid:
    torch.manual_seed(0)
    made = HashGrid(levels, 2, log2_entries, 4, 16)
    torch.nn.init.normal_(made.table)
    return made.double()


def test_a_hash_grid_is_continuous_across_its_cells():
    made = grid()
    points = torch.rand(200, 3, dtype=torch.float64)
    edge = torch.round(points * 16) / 16
    step = 1e-7 * torch.eye(3, dtype=torch.float64)[torch.randint(3, (200,))]
    below, above = made((edge - step).clamp(0, 1)), made((edge + step).clamp(0, 1))
    assert (below - above).abs().max() < 1e-4


def test_a_hash_grid_is_linear_along_an_axis_inside_a_cell():
    made = grid(levels=1)
    ends = torch.tensor([[0.26, 0.3, 0.3], [0.48, 0.3, 0.3]], dtype=torch.float64)
    low, high = made(ends)
    middle = made(ends.mean(0, keepdim=True))[0]
    torch.testing.assert_close(middle, (low + high) / 2)


@pytest.mark.slow
@pytest.mark.parametrize("log2_entries", [5, 12])
def test_what_tables_learn_is_what_automatic_differentiation_finds(log2_entries: int):
    made, points = grid(log2_entries=log2_entries), torch.rand(50, 3, dtype=torch.float64)
    table = made.table.detach().requires_grad_()

    def asked(some: torch.Tensor) -> torch.Tensor:
        return torch.func.functional_call(made, {"table": some}, (points,))

    assert torch.autograd.gradcheck(asked, table, atol=1e-6)


def histogram(rows: int, n: int) -> tuple[torch.Tensor, torch.Tensor]:
    edges = torch.sort(torch.rand(rows, n + 1))[0]
    edges[:, 0], edges[:, -1] = 0, 1
    return edges, F.softmax(torch.randn(rows, n), -1)


def test_the_interlevel_loss_is_0_where_the_proposal_bounds():
    edges, weights = histogram(20, 12)
    assert interlevel_loss(edges, weights, edges, weights) < 1e-6
    coarse = edges[:, ::3]
    sums = weights.unflatten(1, (4, 3)).sum(-1)
    assert interlevel_loss(edges, weights, coarse, sums) < 1e-6
    assert interlevel_loss(edges, weights, coarse, sums * 0.5) > 1e-3


def test_only_the_proposal_learns_from_the_interlevel_loss():
    edges, weights = (one.requires_grad_() for one in histogram(5, 8))
    other = histogram(5, 4)[1].mul(0.1).detach().requires_grad_()
    interlevel_loss(edges, weights, edges.detach()[:, ::2], other).backward()
    assert other.grad is not None
    assert other.grad.abs().sum() > 0
    assert edges.grad is None
    assert weights.grad is None


def test_weights_and_what_passes_make_the_whole():
    density, lengths = 20 * torch.rand(10, 30), 0.01 * torch.rand(10, 30)
    passes = torch.exp(-(density * lengths).sum(-1))
    torch.testing.assert_close(weights_of(density, lengths).sum(-1) + passes, torch.ones(10))


def test_samples_crowd_where_the_weight_is():
    edges = torch.linspace(0, 1, 11)[None]
    weights = torch.zeros(1, 10)
    weights[0, 6] = 1.0
    drawn = resampled(edges, weights, 40, None)
    assert (drawn.diff() >= 0).all()
    assert ((drawn > 0.6) & (drawn < 0.7)).float().mean() > 0.85


def test_a_spike_has_no_distortion_and_the_depth_loss_wants_it_at_the_depth():
    edges = torch.linspace(0, 1, 101)[None]
    spike = torch.zeros(1, 100)
    spike[0, 40] = 1.0
    assert distortion_loss(edges, spike) < distortion_loss(edges, torch.full((1, 100), 0.01)) / 50
    there, elsewhere = (depth_loss(edges, spike, torch.tensor([z]), 0.002) for z in (0.405, 0.6))
    assert there < elsewhere


def test_harmonics_are_orthonormal():
    directions = F.normalize(torch.randn(200_000, 3, generator=torch.Generator().manual_seed(0)), dim=-1)
    values = harmonics(directions)
    gram = 4 * math.pi * values.T @ values / len(values)
    assert (gram - torch.eye(16)).abs().max() < 0.05


@pytest.mark.slow
def test_a_scene_of_exact_depth_is_learned_to_a_few_millimetres():
    seen = seen_of()
    field = fitted(pixels_of(seen), seen.workspace, QUICK, CPU, seed=0)
    assert depth_error(field, pixels_of(seen)) < 0.003
    frame = with_depth(seen).frames[1]
    depth = rendered_depth(field, frame.camera, seen.workspace)
    known = depth > 0
    assert known.mean() > 0.8
    assert np.median(np.abs(depth - frame.depth)[known]) < 0.003


@pytest.mark.slow
def test_a_field_that_learned_nothing_is_one_clear_error():
    seen = seen_of(32)
    with pytest.raises(Diverged, match="misses the given one by"):
        fitted(pixels_of(seen), seen.workspace, replace(QUICK, steps=1), CPU, seed=0)
    with pytest.raises(Diverged, match="its loss is nan after 0 steps"):
        fitted(pixels_of(seen), seen.workspace, replace(QUICK, depth=math.nan), CPU, seed=0)


class Remembers:
    """Takes VGN's place."""

    def detect(self, seen: Observation) -> Detection:
        self.seen = with_depth(seen)
        return Detection(Grasps.of(()), seen.workspace, Gripper.load("panda"), timing_s={"fuse": 1.0})


@pytest.mark.slow
def test_vgn_gets_rendered_depth_where_the_user_has_the_table():
    seen = seen_of()
    placed = from_rotation_vector((0.1, 0.2, 0.3), (1.0, 2.0, 3.0))
    moved = Observation(
        tuple(replace(frame, camera=frame.camera.moved(placed)) for frame in seen.frames),
        replace(seen.workspace, world_from_workspace=placed),
    )
    vgn = Remembers()
    found = NerfDetector(vgn, CPU, QUICK, turns=(0.0, 0.05)).detect(moved)
    assert set(found.timing_s) == {"fit", "render", "fuse"}
    assert len(vgn.seen.frames) == 8
    points = []
    for frame in vgn.seen.frames:
        assert frame.camera.width == 24
        pixels = frame.camera.pixel_grid()[frame.depth > 0]
        points.append(frame.camera.unproject(pixels, frame.depth[frame.depth > 0]))
    heights = (np.concatenate(points) - placed[:3, 3]) @ placed[:3, 2]
    assert abs(np.median(heights) - seen.workspace.table_height) < 0.003


def test_photos_are_needed():
    seen = seen_of(32)
    blind = Observation(tuple(replace(f, image=None, background=None) for f in seen.frames), seen.workspace)
    with pytest.raises(InputError, match="has no photo"):
        NerfDetector(Remembers(), CPU).detect(blind)


def test_weights_are_those_of_vgn(tmp_path: Path):
    with pytest.raises(InputError, match=r"none\.pth"):
        SPEC.load(DetectorOptions(weights=str(tmp_path / "none.pth")))
    with pytest.raises(InputError, match="weights of the network 'neugrasp', not 'vgn'"):
        SPEC.load(DetectorOptions(weights="neugrasp-tsdf"))
