"""Many points in pieces that fit the cache, on as many threads as PyTorch computes with.

An operation that PyTorch itself shares between threads ends when the last of them does, a hundred times in a
piece. Here each thread has pieces of its own, there and back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from typing import Any, TypeVar

import torch
from torch import Tensor

POINTS = {"cpu": 4096, "cuda": 2**18}
"""Points at a time: for a GPU as many as fill it."""
WITH_GRADIENT = 4
"""So many times as many where a gradient is wanted: what is kept leaves the cache anyway."""

A = TypeVar("A")
B = TypeVar("B")
Piece = Callable[[int, int], tuple[Tensor, ...]]


def in_chunks(
    function: Piece, num: int, device: torch.device, points_each: int, learns: Iterable[Tensor]
) -> tuple[Tensor, ...]:
    """What `function(start, stop)` gives for `num` things of so many points each, joined along axis 0.

    `learns` are all tensors through which a gradient leaves the function.
    """
    wants = [tensor for tensor in learns if tensor.requires_grad] if torch.is_grad_enabled() else []
    points = POINTS[device.type] * (WITH_GRADIENT if wants else 1)
    threads = torch.get_num_threads() if device.type == "cpu" else 1
    rounds = math.ceil(num / max(1, points // points_each) / threads)
    size = math.ceil(num / (rounds * threads))
    pieces = [(start, min(start + size, num)) for start in range(0, num, size)]
    if wants:
        result: tuple[Tensor, ...] = _Pieces.apply(function, pieces, threads, *wants)
        return result
    return _joined(in_threads(lambda piece: function(*piece), pieces, threads))


class _Pieces(torch.autograd.Function):
    """Every piece has a graph of its own, so that gradients are made in threads, too."""

    @staticmethod
    def forward(
        ctx: Any, function: Piece, pieces: list[tuple[int, int]], threads: int, *wants: Tensor
    ) -> tuple[Tensor, ...]:
        def made(piece: tuple[int, int]) -> tuple[Tensor, ...]:
            with torch.enable_grad():
                return function(*piece)

        ctx.pieces, ctx.threads, ctx.wants = pieces, threads, wants
        ctx.parts = in_threads(made, pieces, threads)
        ctx.set_materialize_grads(False)
        joined = _joined(ctx.parts)
        ctx.mark_non_differentiable(*(one for one in joined if not one.is_floating_point()))
        return joined

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor | None) -> tuple[Tensor | None, ...]:
        def pulled(index: int) -> tuple[Tensor | None, ...]:
            some = slice(*ctx.pieces[index])
            pairs = zip(ctx.parts[index], gradients, strict=True)
            ends = [(part, pull[some]) for part, pull in pairs if pull is not None and part.requires_grad]
            parts, pulls = zip(*ends, strict=True)
            return torch.autograd.grad(parts, ctx.wants, pulls, allow_unused=True)

        found = in_threads(pulled, range(len(ctx.pieces)), ctx.threads)
        ctx.parts = None
        return None, None, None, *(_sum(one) for one in zip(*found, strict=True))


def _joined(parts: Sequence[tuple[Tensor, ...]]) -> tuple[Tensor, ...]:
    return tuple(torch.cat([one.detach() for one in same]) for same in zip(*parts, strict=True))


def _sum(gradients: tuple[Tensor | None, ...]) -> Tensor | None:
    known = [one for one in gradients if one is not None]
    return torch.stack(known).sum(0) if known else None


def in_threads(function: Callable[[A], B], things: Sequence[A], threads: int) -> list[B]:
    """What the function gives for each, on so many threads, on each of which PyTorch computes with one."""
    if threads == 1 or len(things) == 1:
        return [function(thing) for thing in things]
    gradient = torch.is_grad_enabled()
    reduced, kind = torch.is_autocast_enabled("cpu"), torch.get_autocast_dtype("cpu")

    def alone(thing: A) -> B:
        with torch.set_grad_enabled(gradient), torch.autocast("cpu", kind, enabled=reduced):
            return function(thing)

    # Threads that start from now on take over this number.
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with ThreadPoolExecutor(threads) as pool:
            # torch.compile keeps its settings in the context.
            contexts = [copy_context() for _ in things]
            return list(pool.map(lambda thing, context: context.run(alone, thing), things, contexts))
    finally:
        torch.set_num_threads(before)
