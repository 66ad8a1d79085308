"""The state of a stopped run: read once and put back exactly, or refused whatever was done to the file."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import strategies as st
from torch import nn

from damage import damaged_bytes, damaged_json, fuzz, many, split, with_metadata
from neugrasp.errors import InputError
from neugrasp.training.recipes import tiny
from neugrasp.training.state import STATE, Identity, TrainState, read_state, save_state

IDENTITY = Identity(tiny(), "0123")


def learner() -> TrainState[nn.Linear]:
    torch.manual_seed(0)
    return TrainState.of(nn.Linear(3, 2), tiny())


def stepped(learner: TrainState[nn.Linear]) -> TrainState[nn.Linear]:
    learner.model(torch.ones(3)).sum().backward()
    learner.update(1.0)
    return learner


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_state(tmp_path, stepped(learner()), 7, IDENTITY)
    return tmp_path


def restored(folder: Path) -> TrainState[nn.Linear] | None:
    state, again = read_state(folder), learner()
    if state is None:
        return None
    assert type(state.steps_of_head(3)) is int
    assert state.restore(again, IDENTITY) >= 0
    return again


def test_what_was_saved_goes_on_as_if_it_had_not_stopped(folder: Path):
    first, again = stepped(learner()), restored(folder)
    assert again is not None
    for one, other in zip((stepped(first), stepped(again)), (again, first), strict=True):
        torch.testing.assert_close(one.model.state_dict(), other.model.state_dict(), rtol=0, atol=0)
    assert restored(folder / "elsewhere") is None


def test_another_run_is_named_by_what_differs(folder: Path):
    state = read_state(folder)
    assert state is not None
    with pytest.raises(InputError, match="other values of data, init"):
        state.restore(learner(), Identity(tiny(), "4567", "w.safetensors"))


def changed(folder: Path, **notes: str) -> Path:
    header, rest = split(folder / STATE)
    with_metadata(folder / STATE, header, rest, header["__metadata__"] | notes)
    return folder


@pytest.mark.parametrize(
    ("notes", "message"),
    [
        ({"step": "-3"}, "step is '-3'"),
        ({"step": "1e3"}, "step is '1e3'"),
        ({"step": "\u0663"}, "step is"),
        ({"step": "9" * 5000}, "step is '9999"),
        ({"identity": "[" * 100_000}, "too deep"),
        ({"identity": "[]"}, "is not a JSON object"),
        ({"identity": '{"head_steps": "x"}'}, "identity.head_steps is 'x'; it must be a whole number"),
        ({"identity": '{"head_steps": true}'}, "identity.head_steps is True"),
    ],
    ids=lambda value: str(value)[:30],
)
def test_what_no_run_writes_is_named(folder: Path, notes: dict[str, str], message: str):
    with pytest.raises(InputError, match=message):
        restored(changed(folder, **notes))


def test_moments_of_another_shape_are_damage(folder: Path):
    header, rest = split(folder / STATE)
    header["adam.exp_avg.weight"]["shape"] = [3, 2]
    with_metadata(folder / STATE, header, rest, header["__metadata__"])
    with pytest.raises(InputError, match=r"damaged \(adam.exp_avg.weight has shape \(3, 2\)\)"):
        restored(folder)


@pytest.mark.slow
@many
def test_nothing_said_of_a_state_ends_in_anything_but_one_error(examples: int, folder: Path):
    header, rest = split(folder / STATE)
    notes = header["__metadata__"]
    strange = st.one_of(
        damaged_json(json.loads(notes["identity"])).map(lambda text: notes | {"identity": text}),
        st.text(max_size=4).map(lambda text: notes | {"step": text}),
        st.sampled_from(sorted(notes)).map(lambda key: {k: v for k, v in notes.items() if k != key}),
    ).filter(lambda metadata: all("\ud800" not in text for text in metadata.values()))

    def read(metadata: dict[str, str]) -> Any:
        with_metadata(folder / STATE, header, rest, metadata)
        return restored(folder)

    fuzz(read, strange, examples)


@pytest.mark.slow
@many
def test_no_bytes_of_a_state_do(examples: int, folder: Path):
    data = (folder / STATE).read_bytes()
    (size,) = struct.unpack("<Q", data[:8])

    def read(head: bytes) -> Any:
        (folder / STATE).write_bytes(head + data[8 + size :])
        return restored(folder)

    fuzz(read, damaged_bytes(data[: 8 + size]), examples)


def test_what_a_run_writes_down_keeps_its_names():
    """States that are there must be read: a field that is called otherwise makes them another run's."""
    facts = Identity(tiny(), "data").facts()
    assert {
        "model.use_change",
        "model.learned_sharpness",
        "weights.grid_carving",
        "head_steps",
    } <= facts.keys()
