"""The processes of one training run: one alone, or as many as torchrun started."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import fmean

import torch
import torch.distributed
from torch import nn
from torch.nn.parallel import DistributedDataParallel


@dataclass(frozen=True)
class Ranks:
    """Which of the run's processes this is."""

    device: torch.device
    rank: int = 0
    count: int = 1

    @property
    def leads(self) -> bool:
        """Whether this process writes weights, states and logs."""
        return self.rank == 0

    def wrap(self, module: nn.Module) -> nn.Module:
        """The module with its gradients averaged over all processes."""
        if self.count == 1:
            return module
        # The head's stage leaves the rest of the network without gradients.
        return DistributedDataParallel(module, find_unused_parameters=True)

    def mean(self, values: Mapping[str, float]) -> dict[str, float]:
        """Numbers by name, each the mean over the processes that have it; the same in all of them."""
        every = [dict(values)] * self.count
        if self.count > 1:
            torch.distributed.all_gather_object(every, dict(values))
        names = dict.fromkeys(itertools.chain(*every))
        return {name: fmean(one[name] for one in every if name in one) for name in names}

    def agree(self, decided: bool) -> bool:
        """What the first process decided, in all of them."""
        if self.count == 1:
            return decided
        decision = torch.tensor([int(decided)], device=self.device)
        torch.distributed.broadcast(decision, src=0)
        return bool(decision.item())


@contextmanager
def joined_ranks(device: str) -> Iterator[Ranks]:
    """The processes that torchrun started, joined; on CUDA each has the device of its local rank."""
    count, rank = int(os.environ.get("WORLD_SIZE", "1")), int(os.environ.get("RANK", "0"))
    place = torch.device(device)
    if count == 1:
        yield Ranks(place)
        return
    if place.type == "cuda":
        place = torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0")))
        torch.cuda.set_device(place)
    torch.distributed.init_process_group("nccl" if place.type == "cuda" else "gloo")
    try:
        yield Ranks(place, rank, count)
    finally:
        torch.distributed.destroy_process_group()
