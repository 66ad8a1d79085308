"""Training as a whole: it learns, it can be stopped anywhere, and its loss curve does not drift."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from neugrasp.data import records
from neugrasp.data.records import write_record
from neugrasp.errors import InputError
from neugrasp.model.checkpoint import load_checkpoint
from neugrasp.run_folder import lock_folder
from neugrasp.training.command import Train
from neugrasp.training.recipes import RECIPES, configured, recipe
from neugrasp.training.trainer import train

GOLDEN = Path(__file__).parent.parent / "golden" / "tiny_losses.json"


@pytest.fixture
def data(tmp_path, make_record) -> Path:
    """Three balls; the last one is for validation."""
    folder = tmp_path / "data"
    for seed, (x, y) in enumerate([(0.15, 0.15), (0.1, 0.18)]):
        record = make_record(x=x, y=y, seed=seed)
        write_record(folder / "scenes" / record.name, record)
    return folder


@pytest.fixture
def held_out(tmp_path, make_record) -> Path:
    record = make_record(x=0.2, y=0.12, seed=9)
    write_record(tmp_path / "held" / "scenes" / record.name, record)
    return tmp_path / "held"


def losses_of(out: Path) -> list[float]:
    lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    return [line["loss"] for line in lines if "loss" in line]


@pytest.mark.slow
def test_stopped_and_resumed_equals_never_stopped(data, held_out, tmp_path):
    """Stopped inside the head's stage and inside the joint one, between two checkpoints each time."""
    whole = Train(recipe="tiny", data=(data,), out=tmp_path / "whole", validation=(held_out,))
    weights = train(whole)
    parts = Train(recipe="tiny", data=(data,), out=tmp_path / "parts", validation=(held_out,), resume=True)
    for stop in (3, 8, 12):
        same = train(parts, stop_after=stop)
    first, second = load_file(weights), load_file(same)
    assert first.keys() == second.keys()
    assert all(torch.equal(first[name], second[name]) for name in first)
    assert losses_of(whole.out) == losses_of(parts.out)
    assert len(list(whole.out.glob("progress_*.png"))) == 2
    scores = json.loads((whole.out / "log.jsonl").read_text().splitlines()[-1])["validation"]
    named = {"l1_0.3", "l1_0.3_constant_+0", "psnr", "ssim", "grasp_auc", "rotation_error_deg"}
    assert named <= scores.keys()
    assert load_checkpoint(weights).about["recipe"] == "tiny"
    expected = json.loads(GOLDEN.read_text())
    assert losses_of(whole.out) == pytest.approx(expected, rel=1e-5)


@pytest.fixture
def without_photos(tmp_path, make_record) -> Path:
    """A ball that nobody photographed."""
    record = make_record(x=0.12, y=0.2, seed=5)
    bare = replace(record, cell={"photos": False}, **records.without_photos())
    write_record(tmp_path / "bare" / "scenes" / bare.name, bare)
    return tmp_path / "bare"


@pytest.mark.slow
def test_scenes_without_photos_teach_the_head_alone(data, without_photos, tmp_path, monkeypatch):
    monkeypatch.setitem(RECIPES, "tiny-head", lambda: replace(recipe("tiny"), steps=3, head_steps=3))
    first = train(Train(recipe="tiny-head", data=(without_photos,), out=tmp_path / "head"))
    both = Train(recipe="tiny", data=(data, without_photos), out=tmp_path / "both", init=str(first))
    assert train(both).is_file()
    with pytest.raises(InputError, match="no scene has photos; recipe tiny needs some"):
        train(Train(recipe="tiny", data=(without_photos,), out=tmp_path / "tiny"))


@pytest.mark.slow
def test_of_another_network_only_the_head_is_taken(data, without_photos, tmp_path, monkeypatch):
    tiny = recipe("tiny")
    still = replace(tiny.optimiser, learning_rate=0, average=0)
    blind = replace(tiny.model, use_backgrounds=False)
    monkeypatch.setitem(RECIPES, "tiny-head", lambda: replace(tiny, steps=3, head_steps=3))
    monkeypatch.setitem(RECIPES, "blind", lambda: replace(tiny, model=blind, optimiser=still))
    first = train(Train(recipe="tiny-head", data=(without_photos,), out=tmp_path / "head"))
    run = Train(recipe="blind", data=(data,), out=tmp_path / "blind", init=str(first), steps=1, seed=1)
    taken, given = (load_checkpoint(path).tensors for path in (train(run), first))
    assert load_checkpoint(run.out / "weights.safetensors").about["init"] == first.name
    assert all(taken[name].equal(given[name]) for name in given if name.startswith("head."))
    kernels = [name for name in taken if name.startswith("features.") and taken[name].dim() == 4]
    assert kernels
    assert not any(taken[name].equal(given[name]) for name in kernels)

    wider = replace(tiny.model, head_channels=(8, 8, 8))
    monkeypatch.setitem(RECIPES, "wider", lambda: replace(tiny, model=wider))
    with pytest.raises(InputError, match="configured differently"):
        train(Train(recipe="wider", data=(data,), out=tmp_path / "wider", init=str(first)))
    assert not list((tmp_path / "wider").glob("*.safetensors"))


@pytest.mark.slow
def test_some_of_the_scenes(data, tmp_path):
    run = Train(recipe="tiny", data=(data,), out=tmp_path / "one", steps=1, scenes=1)
    assert load_checkpoint(train(run)).about["scenes"] == 1
    for number in (0, 3):
        with pytest.raises(InputError, match=f"--scenes {number}: --data holds 1 to 2"):
            train(replace(run, out=tmp_path / "other", scenes=number))


@pytest.mark.slow
def test_two_trainings_never_share_a_folder(data, tmp_path):
    """The second one neither begins nor touches what the first one wrote."""
    run = Train(recipe="tiny", data=(data,), out=tmp_path / "run", steps=2, validation=(data,))
    train(run)
    half_written = run.out / ".state.safetensors.1"
    half_written.touch()
    before = {path.name: path.read_bytes() for path in run.out.iterdir() if path.is_file()}
    with lock_folder(run.out, "train"):
        for resume in (True, False):
            with pytest.raises(InputError, match="another neugrasp train is writing here; wait for it"):
                train(replace(run, resume=resume, steps=3))
    assert {path.name: path.read_bytes() for path in run.out.iterdir() if path.is_file()} == before
    train(replace(run, resume=True, steps=3))
    assert not half_written.exists()


@pytest.mark.slow
def test_bfloat16_is_left_where_the_processor_is_slow_at_it(data, tmp_path, monkeypatch):
    monkeypatch.setitem(RECIPES, "reduced", lambda: replace(recipe("tiny"), bfloat16=True))
    run = Train(recipe="tiny", data=(data,), out=tmp_path / "tiny", steps=2)
    train(run)
    for capability in ("AVX2", "AVX512"):
        monkeypatch.setattr("torch.backends.cpu.get_cpu_capability", lambda capability=capability: capability)
        train(replace(run, recipe="reduced", out=tmp_path / capability))
    assert losses_of(tmp_path / "AVX2") == losses_of(tmp_path / "tiny")
    assert losses_of(tmp_path / "AVX512") != losses_of(tmp_path / "tiny")


@pytest.mark.slow
def test_an_earlier_run_is_not_overwritten(data, tmp_path):
    run = Train(recipe="tiny", data=(data,), out=tmp_path / "out", steps=2)
    train(run)
    with pytest.raises(InputError, match="--resume"):
        train(run)


@pytest.mark.slow
def test_resuming_with_other_facts_is_refused_and_names_them(data, held_out, tmp_path):
    run = Train(recipe="tiny", data=(data,), out=tmp_path / "out", steps=2)
    train(run)
    for other, named in (
        (replace(run, seed=1), "seed"),
        (replace(run, data=(held_out,)), "data"),
        (replace(run, scenes=1), "data"),
        (replace(run, init=str(run.out / "weights.safetensors")), "init"),
        (replace(run, recipe="without-attention"), r"model\.encoder_blocks"),
    ):
        with pytest.raises(InputError, match=f"other values of .*{named}"):
            train(replace(other, resume=True))


@pytest.mark.slow
def test_a_run_is_extended(data, tmp_path):
    """The stages and the schedule belong to the longer run; what was learned stays."""
    run = Train(recipe="tiny", data=(data,), out=tmp_path / "out")
    train(run, stop_after=5)
    before = losses_of(run.out)
    train(replace(run, steps=15, resume=True))
    assert losses_of(run.out)[:5] == before
    assert len(losses_of(run.out)) == 15


def test_a_folder_without_records_is_named(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty: no scenes"):
        train(Train(recipe="tiny", data=(tmp_path / "empty",), out=tmp_path / "out"))


@pytest.mark.parametrize("name", RECIPES)
def test_every_recipe_builds_and_keeps_the_balance_of_its_stages(name):
    init = "neugrasp" if recipe(name).patience else None
    config = configured(Train(recipe=name, data=(), out=Path(), steps=1000, init=init))
    assert config.steps == 1000
    assert config.head_steps / 1000 == pytest.approx(recipe(name).head_steps / recipe(name).steps, abs=1e-3)
    rates = [config.learning_rate_at(step) for step in range(config.head_steps, 1000)]
    top = int(np.argmax(rates)) if rates else 0  # where the warming up ends
    assert top <= len(rates) / 10 + 1
    assert rates == sorted(rates[:top]) + sorted(rates[top:], reverse=True)


def test_unknown_recipes_are_answered_with_the_known_ones():
    with pytest.raises(InputError, match=r"small.*paper.*tsdf"):
        recipe("nothing")
