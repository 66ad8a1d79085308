"""Two processes that share a step are one process that takes it alone."""

from __future__ import annotations

import os
import socket
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file
from torch import multiprocessing

from neugrasp.data.records import write_record
from neugrasp.training.command import Train
from neugrasp.training.config import TrainConfig
from neugrasp.training.recipes import RECIPES, geometry, tiny
from neugrasp.training.trainer import train

pytestmark = pytest.mark.slow


def recipe(batch: int) -> TrainConfig:
    """Geometry supervision of a tiny network: nothing is drawn but the order of views."""
    return replace(
        geometry(), model=tiny().model, bfloat16=False, columns=0, view_dropout=0.0, batch=batch, steps=6,
        checkpoint_every=2, validation_scenes=1, validate_every=6,
    )  # fmt: skip


def rank(number: int, port: int, run: Train, stop_after: int | None) -> None:
    """One of two processes, as torchrun would start it."""
    os.environ |= {
        "RANK": str(number), "LOCAL_RANK": str(number), "WORLD_SIZE": "2",
        "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port),
    }  # fmt: skip
    torch.set_num_threads(1)
    RECIPES["shared"] = lambda: recipe(batch=1)
    train(run, stop_after=stop_after)


def together(run: Train, stop_after: int | None = None) -> dict[str, torch.Tensor]:
    """The weights of two processes."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    multiprocessing.spawn(rank, (port, run, stop_after), nprocs=2)
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
    run = Train(recipe="alone", data=(data,), validation=(data,), out=tmp_path / "alone", loaders=0)
    alone = load_file(train(run))
    shared = replace(run, recipe="shared", out=tmp_path / "shared")
    both = together(shared)
    for name, weights in alone.items():
        # Another order of views moves last digits, and Adam makes steps of one size of them.
        torch.testing.assert_close(both[name], weights, atol=5e-5, rtol=1e-3)
    assert len((shared.out / "log.jsonl").read_text().splitlines()) == 7  # of the first process alone

    parts = replace(shared, out=tmp_path / "parts")
    together(parts, stop_after=4)
    resumed = together(replace(parts, resume=True))
    assert all(torch.equal(resumed[name], both[name]) for name in both)
