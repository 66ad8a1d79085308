"""Files damaged at random, as hypothesis strategies, and readers that must survive them."""

from __future__ import annotations

import copy
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from neugrasp.errors import InputError


def many(function: Callable[..., None]) -> Callable[..., None]:
    """A hundred examples in the fast suite, 2,000 in the whole one."""
    marks = [100, pytest.param(2000, marks=[pytest.mark.slow, pytest.mark.timeout(1800)])]
    return pytest.mark.parametrize("examples", marks)(function)


def fuzz(read: Callable[[Any], Any], damaged: st.SearchStrategy[Any], examples: int) -> None:
    """Whatever is read comes back, or an `InputError` does."""

    @settings(max_examples=examples, deadline=None, suppress_health_check=list(HealthCheck))
    @given(damaged)
    def run(found: Any) -> None:
        said = "right"
        try:
            read(found)
        except InputError as error:
            said = str(error)
        # It can be printed, and is one that a person reads.
        assert 0 < len(said.encode()) < 2000

    run()


odd = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-5, 5),
    st.integers(),
    st.sampled_from([10**18, 10**29, -(10**29), 10**400, 0.0, -1.0, 1e-300, 1e30, 1e308]),
    st.floats(allow_nan=True, allow_infinity=True),
    st.text(max_size=5),
    st.sampled_from(["", "../../x", "a\0b", "\x1b[2J", "x" * 5000, "1.5", "nan", "{}", "\ud800", "-1"]),
    st.recursive(
        st.one_of(st.none(), st.integers(-3, 3), st.text(max_size=3)),
        lambda inner: st.one_of(
            st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=3), inner, max_size=3)
        ),
        max_leaves=6,
    ),
)


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every place in a JSON value."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(place for key, some in inside for place in places(some, (*path, key)))]


@st.composite
def damaged_json(draw: st.DrawFn, right: Any) -> str:
    """The text of a right value, with up to three things in it changed, taken away, added or said twice."""
    value = copy.deepcopy(right)
    for _ in range(draw(st.integers(0, 3))):
        place = draw(st.sampled_from(places(value)))
        if not place:
            value = draw(odd) if draw(st.booleans()) else value
            continue
        inner = value
        for key in place[:-1]:
            inner = inner[key]
        kind = draw(st.sampled_from(["change", "remove", "add"]))
        if kind == "change" or (kind == "add" and not isinstance(inner, dict)):
            inner[place[-1]] = draw(odd)
        elif kind == "remove":
            del inner[place[-1]]
        else:
            inner[draw(st.text(max_size=4))] = draw(odd)
    text = json.dumps(value)
    kind = draw(st.sampled_from(["", "", "", "cut", "twice", "deep", "byte order mark"]))
    if kind == "cut":
        return text[: draw(st.integers(0, len(text)))]
    if kind == "twice" and text.startswith("{") and len(text) > 2:
        return "{" + text[1:-1] + ", " + text[1:-1] + "}"
    if kind == "deep":
        return "[" * draw(st.integers(1, 2000)) + text
    return "\ufeff" + text if kind else text


@st.composite
def damaged_bytes(draw: st.DrawFn, right: bytes) -> bytes:
    """The bytes of a right file, with some changed, cut out or put in."""
    data = bytearray(right)
    for _ in range(draw(st.integers(0, 4))):
        at = draw(st.integers(0, len(data)))
        kind = draw(st.sampled_from(["change", "cut", "put", "end"]))
        if kind == "change" and at < len(data):
            data[at] = draw(st.integers(0, 255))
        elif kind == "cut":
            del data[at : at + draw(st.integers(1, 50))]
        elif kind == "put":
            data[at:at] = draw(st.binary(max_size=8))
        elif kind == "end":
            del data[at:]
    return bytes(data)


def split(weights: Path) -> tuple[dict[str, Any], bytes]:
    """The header of a safetensors file as JSON, and the rest."""
    data = weights.read_bytes()
    (size,) = struct.unpack("<Q", data[:8])
    return json.loads(data[8 : 8 + size]), data[8 + size :]


def with_metadata(path: Path, header: dict[str, Any], rest: bytes, metadata: dict[str, str]) -> Path:
    """The safetensors file with other notes in its header."""
    text = json.dumps(header | {"__metadata__": metadata}).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + rest)
    return path
