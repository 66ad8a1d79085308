"""Floating-point operations and bytes of what runs, counted as it runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils.flop_counter import flop_registry


class FlopCounter(TorchDispatchMode):
    """Operations of matrix products and convolutions by the type of their numbers; a multiply-add is two.

    PyTorch's own `FlopCounterMode` counts the same, but not by type, and bfloat16 has another roofline.
    """

    def __init__(self) -> None:
        super().__init__()
        self.flops: Counter[torch.dtype] = Counter()

    def __torch_dispatch__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        kwargs = kwargs or {}
        formula = flop_registry.get(func._overloadpacket)
        if formula is None and func is not torch.ops.prim.device.default:
            # Products that come as one `linear` or `matmul` are counted by what they are made of.
            with self:
                result = func.decompose(*args, **kwargs)
            if result is not NotImplemented:
                return result
        result = func(*args, **kwargs)
        if formula is not None:
            dtype = next(argument.dtype for argument in args if isinstance(argument, Tensor))
            self.flops[dtype] += formula(*args, **kwargs, out_val=result)
        return result


def tensors_of(value: Any) -> list[Tensor]:
    """All tensors in nested tuples, lists, dictionaries and dataclasses."""
    if isinstance(value, Tensor):
        return [value]
    if isinstance(value, dict):
        value = value.values()
    elif is_dataclass(value) and not isinstance(value, type):
        value = [getattr(value, field.name) for field in fields(value)]
    elif not isinstance(value, tuple | list):
        return []
    return [tensor for item in value for tensor in tensors_of(item)]


def num_bytes(tensors: list[Tensor], known: list[Tensor] | None = None) -> int:
    """Bytes of the tensors, each place in memory once, without those that are `known`."""
    counted = {_place(tensor) for tensor in known or []}
    total = 0
    for tensor in tensors:
        if _place(tensor) not in counted:
            counted.add(_place(tensor))
            total += tensor.nbytes
    return total


def _place(tensor: Tensor) -> tuple[int, int]:
    return tensor.data_ptr(), tensor.nbytes


class Kept:
    """How many bytes a forward pass keeps for the backward pass."""

    def __init__(self, weights: list[Tensor]):
        self._sizes: dict[int, int] = {}
        self._weights = {tensor.untyped_storage().data_ptr() for tensor in weights}

    @property
    def num_bytes(self) -> int:
        """Bytes of all storages that were kept, weights apart."""
        return sum(self._sizes.values())

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Counts within the block."""
        with torch.autograd.graph.saved_tensors_hooks(self._note, lambda tensor: tensor):
            yield

    def _note(self, tensor: Tensor) -> Tensor:
        storage = tensor.untyped_storage()
        if storage.data_ptr() not in self._weights:
            self._sizes[storage.data_ptr()] = storage.nbytes()
        # An output kept as it is would hold the node that holds it, for ever.
        return tensor.detach()
