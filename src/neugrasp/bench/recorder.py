"""Stages of a computation, measured while it runs: seconds, and on request operations and bytes."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor, nn

from neugrasp.bench.counting import FlopCounter, num_bytes, tensors_of


@dataclass
class Cost:
    """What a stage needs, without the stages inside it."""

    seconds: float = 0.0
    flops: dict[str, int] = field(default_factory=dict)
    """By type of number: float32, bfloat16."""
    num_bytes: int = 0
    """Inputs, outputs and weights, each once."""

    def add(self, other: Cost) -> None:
        """Another run of the same stage."""
        self.seconds += other.seconds
        self.num_bytes += other.num_bytes
        for dtype, count in other.flops.items():
            self.flops[dtype] = self.flops.get(dtype, 0) + count


Moment = float | torch.cuda.Event


class Clock:
    """Moments of the CPU, or of the GPU's stream: there, marks cost nothing and nobody waits."""

    def __init__(self, device: torch.device):
        self.device = device

    def now(self) -> Moment:
        """This moment, in the order of the work that was given to the device."""
        if self.device.type != "cuda":
            return time.perf_counter()
        event = torch.cuda.Event(enable_timing=True)
        event.record()
        return event

    def between(self, start: Moment, end: Moment) -> float:
        """Seconds; on a GPU only after `finish`."""
        if isinstance(start, float) and isinstance(end, float):
            return end - start
        return float(start.elapsed_time(end)) / 1000  # type: ignore[union-attr,arg-type]

    def finish(self) -> None:
        """Waits until the device has done everything."""
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)


@dataclass
class _Span:
    name: str
    parent: _Span | None
    owner: nn.Module | None
    start: Moment
    end: Moment | None = None
    flops_before: dict[torch.dtype, int] = field(default_factory=dict)
    cost: Cost = field(default_factory=Cost)
    """Flops of this span with all inside it, bytes without."""
    handed_in: list[Tensor] = field(default_factory=list)
    handed_out: list[Tensor] = field(default_factory=list)
    """What the stages inside got, and what they gave."""


class Recorder:
    """Collects the costs of stages by name. Stages may lie in one another; each counts for itself."""

    def __init__(self, device: torch.device, counter: FlopCounter | None = None):
        self.clock = Clock(device)
        self.counter = counter
        self._spans: list[_Span] = []
        self._notes: list[tuple[str, Cost]] = []
        self._inner: _Span | None = None

    @contextmanager
    def stage(self, name: str, owner: nn.Module | None = None) -> Iterator[_Span]:
        """Everything in the block is the stage's."""
        span = _Span(name, self._inner, owner, self.clock.now())
        if self.counter:
            span.flops_before = dict(self.counter.flops)
        self._spans.append(span)
        self._inner = span
        yield span
        self._inner = span.parent
        span.end = self.clock.now()
        if self.counter:
            before = span.flops_before
            counted = {kind: count - before.get(kind, 0) for kind, count in self.counter.flops.items()}
            span.cost.flops = {str(kind).removeprefix("torch."): n for kind, n in counted.items() if n}

    def call(
        self, name: str, owner: nn.Module | None, function: Callable[..., Any], *args: Any, **kw: Any
    ) -> Any:
        """The function's result, its cost under `name`; the weights are the `owner`'s.

        Inside a stage of the same owner it is that stage's.
        """
        if owner is not None and self._inner is not None and self._inner.owner is owner:
            return function(*args, **kw)
        with self.stage(name, owner) as span:
            result = function(*args, **kw)
        if self.counter:
            inputs, outputs = tensors_of((args, kw)), tensors_of(result)
            weights = list(owner.parameters()) if owner is not None else []
            read = num_bytes([*inputs, *weights, *span.handed_in], span.handed_out)
            span.cost.num_bytes = read + num_bytes(outputs, [*inputs, *span.handed_in, *span.handed_out])
            if span.parent is not None:
                span.parent.handed_in += inputs
                span.parent.handed_out += outputs
        return result

    def note(self, name: str, cost: Cost) -> None:
        """Adds what was found out elsewhere."""
        self._notes.append((name, cost))

    def costs(self) -> dict[str, Cost]:
        """By stage, in the order in which they first came; what lies inside a stage is taken off it."""
        self.clock.finish()
        total: dict[str, Cost] = {span.name: Cost() for span in self._spans}
        for span in self._spans:
            assert span.end is not None
            seconds = self.clock.between(span.start, span.end)
            total[span.name].add(Cost(seconds, span.cost.flops, span.cost.num_bytes))
            if span.parent is not None:
                inside = {kind: -count for kind, count in span.cost.flops.items()}
                total[span.parent.name].add(Cost(-seconds, inside))
        for name, cost in self._notes:
            total.setdefault(name, Cost()).add(cost)
        return total


@dataclass(frozen=True)
class Part:
    """A method of a network that is a stage."""

    stage: str
    method: str
    """Its path from the network: `field.on_grid`."""
    weights: str | None = None
    """Path of the module whose weights it reads; None: those of the parts inside it."""


@contextmanager
def watched(network: nn.Module, parts: tuple[Part, ...], recorder: Recorder) -> Iterator[None]:
    """Within the block, every call of a part of the network is a stage of the recorder."""
    with ExitStack() as undo:
        for part in parts:
            path, _, name = part.method.rpartition(".")
            owner = _follow(network, path)
            if owner is None:
                continue
            weights = None if part.weights is None else _follow(network, part.weights)
            method = getattr(owner, name)
            setattr(owner, name, functools.partial(recorder.call, part.stage, weights, method))
            undo.callback(delattr, owner, name)
        yield


def _follow(network: nn.Module, path: str) -> nn.Module | None:
    """The module at a path; None where the network is configured without it."""
    module: Any = network
    for name in path.split(".") if path else []:
        module = getattr(module, name)
    return module if isinstance(module, nn.Module) else None
