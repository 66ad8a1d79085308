"""Markers that were found in a photo, by their numbers."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from typing import Any

import numpy as np

from neugrasp.errors import InputError
from neugrasp.geometry.lens import Lens
from neugrasp.geometry.pose import Array

Seen = Mapping[int, Array]
"""Pixels (4, 2) of the corners of markers, by number."""


def named(corners: Any, numbers: Any) -> list[tuple[int, Array]]:
    if numbers is None:
        return []
    return [
        (int(number), np.asarray(four, dtype=np.float64).reshape(4, 2))
        for number, four in zip(np.ravel(numbers), corners, strict=True)
    ]


def once(found: list[tuple[int, Array]], ours: Container[int], what: str) -> dict[int, Array]:
    """By number. Raises `InputError` where a number of the board is there twice: which of the two is "
    "meant?"""
    names = [number for number, _ in found]
    if twice := sorted({number for number in names if number in ours and names.count(number) > 1}):
        raise InputError(
            f"{what} {listed(twice)} is seen more than once; take the other prints of that number out of the "
            "photo"
        )
    return dict(found)


def straightened(seen: Mapping[int, Array], lens: Lens | None) -> dict[int, Array]:
    return {number: pixels if lens is None else lens.ideal(pixels) for number, pixels in seen.items()}


def listed(numbers: Iterable[int]) -> str:
    """The first few numbers, in order."""
    words = [str(number) for number in sorted(numbers)]
    return ", ".join(words[:8]) + (", ..." if len(words) > 8 else "")
