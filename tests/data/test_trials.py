"""Tables of trials: what is written comes back, joining loses and doubles nothing, damage is named."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from record_strategies import assert_same_trials, tables

from damage import damaged_json, fuzz, many
from neugrasp.data.npz import npz_arrays, npz_bytes
from neugrasp.data.trials import KINDS, Trials, joined, trials_from_bytes, trials_to_bytes
from neugrasp.errors import InputError

FEW = settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@pytest.fixture
def trials() -> Trials:
    found: list[Trials] = []

    @settings(max_examples=20, derandomize=True, database=None, deadline=None)
    @given(tables())
    def keep(example: Trials) -> None:
        found.append(example)

    keep()
    return next(table for table in found if len(table) > 3 and len(table.met) > 1)


def told(trials: Trials) -> list[tuple[object, ...]]:
    """Each trial with what its numbers stand for."""
    return [
        (
            trials.positions[i].tobytes(),
            trials.quaternions[i].tobytes(),
            float(trials.widths[i]),
            bool(trials.success[i]),
            trials.reason_names[trials.reasons[i]],
            trials.met[trials.states[i]].scene,
            trials.met[trials.states[i]].distance.tobytes(),
            json.dumps(trials.made[trials.series[i]]),
        )
        for i in range(len(trials))
    ]


@pytest.mark.slow
@FEW
@given(tables())
def test_trials_come_back_as_they_were_and_give_the_same_bytes(trials: Trials) -> None:
    data = trials_to_bytes(trials)
    again = trials_from_bytes(data, "trials.npz")
    assert_same_trials(again, trials)
    assert trials_to_bytes(again) == data


@FEW
@given(tables(), tables())
def test_joined_tables_hold_each_trial_once_with_the_same_meaning(one: Trials, other: Trials) -> None:
    both = joined(one, other)
    assert told(both) == told(one) + told(other)
    assert len(set(both.reason_names)) == len(both.reason_names)
    assert joined(None, one) is one


def test_a_state_and_a_series_that_both_have_are_told_once(trials: Trials) -> None:
    both = joined(trials, replace(trials, met=trials.met[::-1]))
    assert (len(both), len(both.met), both.made) == (2 * len(trials), len(trials.met), trials.made)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"positions": np.zeros((3, 2), np.float32)}, "positions is float32"),
        ({"quaternions": np.zeros((1, 4), np.float32)}, "quaternions is float32"),
        ({"widths": "float64"}, "widths is float64"),
        ({"reasons": 9}, "reasons names number 9 of"),
        ({"states": 9}, "states names number 9 of"),
        ({"series": 9}, "series names number 9 of"),
        ({"distances": np.zeros((1, 40, 40, 40), np.float16)}, "distances has shape"),
        ({"about": np.frombuffer(b"{", np.uint8)}, "not valid JSON"),
        ({"about": np.frombuffer(b"[" * 100_000, np.uint8)}, "too deep"),
        ({"about": np.frombuffer(b"[]", np.uint8)}, "about is not a JSON object"),
        ({"about": np.frombuffer(b'{"format": "neugrasp-trials", "version": 2}', np.uint8)}, "version is 2"),
        (
            {"about": np.frombuffer(b'{"format": "neugrasp-trials", "version": 1}', np.uint8)},
            "reasons is missing",
        ),
    ],
)
def test_a_damaged_table_is_named(change: dict[str, object], message: str, trials: Trials) -> None:
    arrays = npz_arrays(trials_to_bytes(trials), KINDS, "trials.npz")
    for name, value in change.items():
        if isinstance(value, str):
            arrays[name] = arrays[name].astype(value)
        elif isinstance(value, int):
            arrays[name] = np.full_like(arrays[name], value)
        else:
            arrays[name] = np.asarray(value)
    with pytest.raises(InputError, match=message) as caught:
        trials_from_bytes(npz_bytes(**arrays), "there/trials.npz")
    assert "there/trials.npz" in str(caught.value)


@pytest.mark.slow
@many
def test_nothing_said_of_trials_ends_in_anything_but_one_error(examples: int, trials: Trials) -> None:
    arrays = npz_arrays(trials_to_bytes(trials), KINDS, "trials.npz")
    right = json.loads(arrays["about"].tobytes())

    def read(text: str) -> None:
        about = np.frombuffer(text.encode("utf-8", "surrogatepass"), np.uint8)
        told(trials_from_bytes(npz_bytes(**{**arrays, "about": about}), "trials.npz"))

    fuzz(read, damaged_json(right), examples)
