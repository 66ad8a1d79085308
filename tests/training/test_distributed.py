"""Two processes that share a step are one process that takes it alone."""

from __future__ import annotations

import json
import os
import socket
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file
from torch import multiprocessing

from neugrasp.data.records import write_record
from neugrasp.training import module
from neugrasp.training.command import Train
from neugrasp.training.config import TrainConfig
from neugrasp.training.recipes import RECIPES, geometry, tiny
from neugrasp.training.samples import Photos
from neugrasp.training.trainer import train

pytestmark = pytest.mark.slow
FEW = 6


def recipe(batch: int, steps: int = FEW) -> TrainConfig:
    """Geometry supervision of a tiny network: nothing is drawn but the order of views, which is kept."""
    return replace(
        geometry(), model=tiny().model, bfloat16=False, columns=0, view_dropout=0.0, batch=batch, steps=steps,
        checkpoint_every=2, validation_scenes=1, validate_every=steps,
    )  # fmt: skip


def in_order(photos: Photos, _config: TrainConfig, _generator: torch.Generator) -> Photos:
    """In place of `some_views`, which shuffles: another order of views moves last digits."""
    return photos


def rank(number: int, port: int, run: Train, stop_after: int | None, steps: int) -> None:
    """One of two processes, as torchrun would start it."""
    os.environ |= {
        "RANK": str(number), "LOCAL_RANK": str(number), "WORLD_SIZE": "2",
        "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port),
    }  # fmt: skip
    torch.set_num_threads(1)
    RECIPES["shared"] = lambda: recipe(batch=1, steps=steps)
    module.some_views = in_order
    train(run, stop_after=stop_after)


def together(run: Train, stop_after: int | None = None, steps: int = FEW) -> dict[str, torch.Tensor]:
    """The weights of two processes."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    multiprocessing.spawn(rank, (port, run, stop_after, steps), nprocs=2)
    return load_file(run.out / "weights.safetensors")


@pytest.fixture
def data(tmp_path: Path, make_record) -> Path:
    for seed in range(4):
        record = make_record(x=0.11 + 0.02 * seed, seed=seed)
        write_record(tmp_path / "data" / "scenes" / record.name, replace(record, distance=record.tsdf))
    return tmp_path / "data"


def test_two_processes_learn_what_one_does_at_the_same_batch(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(RECIPES, "alone", lambda: recipe(batch=2))
    monkeypatch.setattr(module, "some_views", in_order)
    run = Train(recipe="alone", data=(data,), validation=(data,), out=tmp_path / "alone", loaders=0)
    alone = load_file(train(run))
    shared = replace(run, recipe="shared", out=tmp_path / "shared")
    both = together(shared)
    for name, weights in alone.items():
        # The mean of two losses moves last digits, and Adam makes steps of one size of them.
        torch.testing.assert_close(both[name], weights, atol=5e-5, rtol=1e-3)
    assert len((shared.out / "log.jsonl").read_text().splitlines()) == 7  # of the first process alone

    parts = replace(shared, out=tmp_path / "parts")
    together(parts, stop_after=4)
    resumed = together(replace(parts, resume=True))
    assert all(torch.equal(resumed[name], both[name]) for name in both)


def losses_of(out: Path) -> list[float]:
    lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    return [line["loss"] for line in lines if "loss" in line]


def test_their_losses_stay_within_a_hundred_thousandth_over_fifty_steps(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Weights that nothing depends on drift apart, as Adam makes steps of one size; the losses do not."""
    monkeypatch.setitem(RECIPES, "alone", lambda: recipe(batch=2, steps=50))
    monkeypatch.setattr(module, "some_views", in_order)
    run = Train(recipe="alone", data=(data,), validation=(data,), out=tmp_path / "alone", loaders=0)
    train(run)
    shared = replace(run, recipe="shared", out=tmp_path / "shared")
    together(shared, steps=50)
    one, two = losses_of(run.out), losses_of(shared.out)
    assert len(one) == len(two) == 50
    assert one[-1] < 0.8 * one[0]
    assert two == pytest.approx(one, rel=0, abs=1e-5)
