"""Many points in pieces that fit the cache, so that passes over them cost no trip to the memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import torch

POINTS = {"cpu": 4096, "cuda": 2**18}
"""Points at a time: for a GPU as many as fill it."""
WITH_GRADIENT = 4
"""So many times as many where a gradient is wanted: what is kept leaves the cache anyway."""

T = TypeVar("T")


def in_chunks(
    function: Callable[[int, int], T], num: int, device: torch.device, points_each: int = 1
) -> list[T]:
    """What `function(start, stop)` gives for consecutive pieces of `num` things of so many points each."""
    points = POINTS[device.type] * (WITH_GRADIENT if torch.is_grad_enabled() else 1)
    size = max(1, points // points_each)
    return [function(start, min(start + size, num)) for start in range(0, num, size)]
