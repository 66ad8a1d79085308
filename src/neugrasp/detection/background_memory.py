"""Feature maps of the empty tables of some cells, which are made once for each."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock

import torch
from jaxtyping import Float
from torch import Tensor

CELLS = 4
"""How many are remembered: 5 MB each with the shipped weights."""


class BackgroundMemory:
    """The last backgrounds with their feature maps, for any number of threads.

    A pair is kept and given out as a whole: two threads at two cells never mix them.
    """

    def __init__(self, cells: int = CELLS):
        """Remembers `cells` of them, at least one; those asked for longest ago go first."""
        self.cells = cells
        self.hits = self.misses = 0
        """How often maps were found, and how often they were made."""
        self._kept: list[tuple[Tensor, Tensor]] = []
        self._lock = Lock()

    def maps(
        self, backgrounds: Float[Tensor, "views 3 size size"], encode: Callable[[Tensor], Tensor]
    ) -> Float[Tensor, "views channels height width"]:
        """The feature maps of backgrounds, made by `encode` where they are not known."""
        with self._lock:
            known = list(self._kept)
        found = next((pair for pair in known if _same(pair[0], backgrounds)), None)
        made = found or (backgrounds, encode(backgrounds))
        with self._lock:
            self.hits, self.misses = self.hits + (found is not None), self.misses + (found is None)
            others = [pair for pair in self._kept if pair is not made]
            self._kept = [made, *others][: self.cells]
        return made[1]


def _same(one: Tensor, other: Tensor) -> bool:
    return one.shape == other.shape and torch.equal(one, other)
