"""kill -9 at any moment: the command that is started again ends with what an undisturbed one makes."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import time
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

import interruptible
from neugrasp.data.records import Record, read_record, write_record

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]

KILLS = 20
UNRECORDED = (".lock", ".lock-workers", "timing.json")

Start = Callable[[Path], BaseProcess]
Check = Callable[[Path], None]


@pytest.fixture(scope="module")
def child() -> Callable[..., BaseProcess]:
    """Starts a function in a process of its own, which has the heavy modules at once."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(
        ["neugrasp.cli", "neugrasp.training.trainer", "neugrasp.simulation.scene_generator"]
    )

    def start(function: Callable[..., None], *arguments: Any) -> BaseProcess:
        process = context.Process(target=function, args=arguments)
        process.start()
        return process

    return start


def finish(start: Start, out: Path) -> float:
    """Lets the command end by itself; the seconds that it took."""
    began = time.monotonic()
    process = start(out)
    process.join()
    assert process.exitcode == 0
    return time.monotonic() - began


def kill_again_and_again(
    start: Start, folder: Path, duration: float, after_kill: Check, at_end: Check
) -> None:
    """Kills `KILLS` times, each at a random moment of a run of about `duration` seconds.

    A run that comes to its end in spite of that is checked, and another one is begun.
    """
    rng = np.random.default_rng(0)
    kills, runs = 0, 0
    while kills < KILLS:
        out = folder / str(runs)
        process = start(out)
        process.join(rng.uniform(0, duration))
        if process.exitcode is None:
            process.kill()
            process.join()
            kills += 1
            after_kill(out)
        else:
            assert process.exitcode == 0
            at_end(out)
            runs += 1
    finish(start, folder / str(runs))
    at_end(folder / str(runs))


def digest(out: Path) -> dict[str, str]:
    """Hash of every file that belongs to a data set, and of those that should not be there."""
    files = [path for path in sorted(out.rglob("*")) if path.is_file() and path.name not in UNRECORDED]
    return {str(p.relative_to(out)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def test_generate(child: Callable[..., BaseProcess], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def start(out: Path) -> BaseProcess:
        return child(interruptible.generate_a_little, out)

    def every_record_is_whole(out: Path) -> None:
        for folder in (out / "scenes").glob("[!.]*"):
            read_record(folder)

    def same_bytes(out: Path) -> None:
        assert digest(out) == expected

    finish(start, tmp_path / "first")
    duration = finish(start, tmp_path / "whole")
    expected = digest(tmp_path / "whole")
    assert sum(name.endswith("grasps.npz") for name in expected) == 3
    assert digest(tmp_path / "first") == expected
    kill_again_and_again(start, tmp_path / "killed", duration, every_record_is_whole, same_bytes)


def test_train(child: Callable[..., BaseProcess], tmp_path: Path, make_record: Callable[..., Record]) -> None:
    data, held_out = tmp_path / "data", tmp_path / "held_out"
    for seed, folder in enumerate((data, data, held_out)):
        record = make_record(x=0.1 + 0.03 * seed, seed=seed)
        write_record(folder / record.name, record)

    def start(out: Path) -> BaseProcess:
        return child(interruptible.train_a_little, data, held_out, out)

    def nothing(out: Path) -> None:
        pass

    def same_run(out: Path) -> None:
        weights = load_file(out / "weights.safetensors")
        assert weights.keys() == expected.keys()
        assert all(torch.equal(weights[name], expected[name]) for name in expected)
        assert log_of(out) == log
        assert files_of(out) == files

    duration = finish(start, tmp_path / "whole")
    expected = load_file(tmp_path / "whole" / "weights.safetensors")
    log, files = log_of(tmp_path / "whole"), files_of(tmp_path / "whole")
    assert [line["step"] for line in log if "loss" in line] == list(range(12))
    assert sum("validation" in line for line in log) == 2
    kill_again_and_again(start, tmp_path / "killed", duration, nothing, same_run)


def log_of(out: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]


def files_of(out: Path) -> set[str]:
    """Names of what a run leaves behind, hidden files too, but not TensorBoard's, which has one per start."""
    return {file.name for file in out.iterdir() if file.name != "tensorboard"}
