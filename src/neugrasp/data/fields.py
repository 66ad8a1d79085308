"""One object of a JSON file, read field by field with messages that name the file and the field."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp.errors import InputError

REMARKS = ("comment", "comments", "note", "notes", "description")
"""Fields for people alone, with those that begin with an underscore."""
SHOWN = 60
"""Characters of a wrong value that a message shows."""


class Fields:
    """The fields of an object, each of the type that was asked for."""

    def __init__(self, source: str, data: Any, prefix: str = ""):
        """Raises `InputError` where `data` is no object."""
        self.source, self.prefix = source, prefix
        if not isinstance(data, dict):
            raise InputError(f"{source}: {prefix.rstrip('.') or 'the file'} is not a JSON object")
        self.data: dict[str, Any] = data

    def refuse(self, field: str, problem: str) -> InputError:
        """The error that names the file, the field and the problem."""
        return InputError(f"{self.source}: {self.prefix}{field} {problem}")

    def get(self, field: str) -> Any:
        """The value, of whatever type."""
        if field not in self.data:
            raise self.refuse(field, f"is missing; present: {_cut(', '.join(self.data)) or 'nothing'}")
        return self.data[field]

    def expect(self, name: str, newest: int) -> None:
        """Checks "format" and "version" of the object."""
        if self.data.get("format") != name:
            raise self.refuse("format", f"is {shown(self.data.get('format'))}; it must be {name!r}")
        version = self.whole("version", -(10**9), 10**9)
        if version != newest:
            hint = "; update neugrasp" if version > newest else ""
            raise self.refuse("version", f"is {version}; this program reads version {newest}{hint}")

    def only(self, names: Iterable[str]) -> None:
        """Checks that there is no other field than these, but for remarks."""
        known = tuple(names)
        for unknown in sorted(name for name in set(self.data) - {*known, *REMARKS} if name[:1] != "_"):
            near = difflib.get_close_matches(unknown, known, n=1)
            raise self.refuse(unknown, f"is unknown{f'; did you mean {near[0]!r}?' if near else ''}")

    def inside(self, field: str) -> Fields:
        """The object under a name."""
        return Fields(self.source, self.get(field), f"{self.prefix}{field}.")

    def each(self, field: str) -> list[Fields]:
        """The objects in the list under a name."""
        return [Fields(self.source, x, f"{self.prefix}{field}[{i}].") for i, x in enumerate(self.list(field))]

    def list(self, field: str) -> list[Any]:
        """The list under a name."""
        value = self.get(field)
        if not isinstance(value, list):
            raise self.refuse(field, f"is {shown(value)}; it must be a list")
        return value

    def text(self, field: str, allowed: tuple[str, ...] = ()) -> str:
        """A text, one of the allowed ones where there are any."""
        value = self.get(field)
        if not isinstance(value, str) or (allowed and value not in allowed):
            wanted = f"one of {', '.join(map(repr, allowed))}" if allowed else "a text"
            raise self.refuse(field, f"is {shown(value)}; it must be {wanted}")
        return value

    def flag(self, field: str) -> bool:
        """true or false."""
        value = self.get(field)
        if not isinstance(value, bool):
            raise self.refuse(field, f"is {shown(value)}; it must be true or false")
        return value

    def number(self, field: str, low: float, high: float, unit: str = "") -> float:
        """A number in [low, high]."""
        value = self.get(field)
        if not is_number(value) or not low <= value <= high:
            wanted = f"a number from {low:g} to {high:g} {unit}".rstrip()
            raise self.refuse(field, f"is {shown(value)}; it must be {wanted}")
        return float(value)

    def each_number(self, low: float, high: float) -> dict[str, float]:
        """All fields, each a number in [low, high]."""
        return {name: self.number(name, low, high) for name in self.data}

    def whole(self, field: str, low: int, high: int) -> int:
        """A whole number in [low, high]."""
        value = self.get(field)
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.refuse(field, f"is {shown(value)}; it must be a whole number from {low} to {high}")
        return value

    def numbers(self, field: str, length: int, limit: float, what: str) -> NDArray[np.float64]:
        """An array (length,) of numbers within `limit` of 0; `what` describes it."""
        value = self.get(field)
        if not _is_row(value, length, limit):
            raise self.refuse(field, f"is not {what} (it is {shown(value)})")
        return np.array(value, dtype=np.float64)

    def unit(self, field: str, length: int) -> NDArray[np.float64]:
        """A vector (length,) of length 1, to a hundredth."""
        vector = self.numbers(field, length, 2.0, f"a list of {length} numbers")
        if not abs(float(np.linalg.norm(vector)) - 1) <= 0.01:
            raise self.refuse(field, f"has length {np.linalg.norm(vector):.3g}; it must be 1")
        return vector

    def rows(self, field: str, length: int, limit: float, what: str) -> NDArray[np.float64]:
        """An array (n, length) of numbers within `limit` of 0; `what` describes it."""
        value = self.get(field)
        if not isinstance(value, list) or not all(_is_row(row, length, limit) for row in value):
            raise self.refuse(field, f"is not {what} (it is {shown(value)})")
        return np.array(value, dtype=np.float64).reshape(-1, length)


def is_number(value: Any) -> bool:
    """Whether a value of JSON is a number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_row(value: Any, length: int, limit: float) -> bool:
    return (
        isinstance(value, list)
        and len(value) == length
        and all(is_number(x) and abs(x) <= limit for x in value)
    )


def shown(value: Any) -> str:
    """A value as a message shows it, cut where it is long."""
    return _cut(repr(value))


def _cut(words: str) -> str:
    return words if len(words) <= SHOWN else words[:SHOWN] + " ..."
