"""Many points in pieces that fit the cache, so that passes over them cost no trip to the memory.

For the backward pass every piece may be computed again, where there is no memory for what lies between.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TypeVar

import torch
from torch.utils.checkpoint import checkpoint

POINTS = {"cpu": 4096, "cuda": 2**18}
"""Points at a time: for a GPU as many as fill it."""
WITH_GRADIENT = 4
"""So many times as many where a gradient is wanted: what is kept leaves the cache anyway."""

T = TypeVar("T")


def in_chunks(
    function: Callable[[int, int], T],
    num: int,
    device: torch.device,
    points_each: int = 1,
    recompute: bool = False,
) -> list[T]:
    """What `function(start, stop)` gives for consecutive pieces of `num` things of so many points each."""
    points = POINTS[device.type] * (WITH_GRADIENT if torch.is_grad_enabled() else 1)
    size = max(1, points // points_each)
    pieces = [(start, min(start + size, num)) for start in range(0, num, size)]
    if len(pieces) == 1 or not recompute or not torch.is_grad_enabled():
        return [function(*piece) for piece in pieces]
    again = functools.partial(
        checkpoint, function, use_reentrant=False, preserve_rng_state=False, determinism_check="none"
    )
    return [again(*piece) for piece in pieces]
