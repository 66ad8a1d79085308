"""Many points in pieces, so that what lies between two layers stays in a processor's cache."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import torch
from jaxtyping import Shaped
from torch import Tensor

CPU_POINTS = 4096
"""Points at a time on a CPU: half a megabyte of channels. Other devices take all points at once."""
WITH_GRADIENT = 4
"""So many times as many where a gradient is wanted: what is kept for it leaves the cache anyway."""

Pieces = TypeVar("Pieces", bound=Sequence[Tensor])


def map_chunked(
    function: Callable[[slice], tuple[Tensor, ...]], num: int, points_each: int, device: torch.device
) -> tuple[Shaped[Tensor, " _ *_"], ...]:
    """What `function` gives for slices of `num` items of `points_each` points, joined along axis 0.

    Gradients pass through it to whatever the function reads.
    """
    points = CPU_POINTS * (WITH_GRADIENT if torch.is_grad_enabled() else 1)
    size = num if device.type != "cpu" else max(1, points // points_each)
    if size >= num:
        return function(slice(0, num))
    pieces = [function(slice(start, min(start + size, num))) for start in range(0, num, size)]
    return tuple(torch.cat(same) for same in zip(*pieces, strict=True))
