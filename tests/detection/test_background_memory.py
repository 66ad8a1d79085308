"""Backgrounds that were seen are known again, as many as are asked for, and never those of another cell."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from neugrasp.detection.background_memory import BackgroundMemory


class Encoder:
    """Doubles, and counts."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, images: Tensor) -> Tensor:
        self.calls += 1
        return 2 * images


@pytest.fixture
def encode() -> Encoder:
    return Encoder()


def cell(number: int, views: int = 4) -> Tensor:
    return torch.full((views, 3, 2, 2), float(number))


@pytest.mark.parametrize(("cells", "calls"), [(1, 6), (2, 6), (3, 3)])
def test_each_is_made_once_if_there_is_room_for_all_in_turn(encode: Encoder, cells: int, calls: int):
    memory = BackgroundMemory(cells)
    for number in (0, 1, 2, 0, 1, 2):
        assert torch.equal(memory.maps(cell(number), encode), 2 * cell(number))
    assert (encode.calls, memory.misses, memory.hits) == (calls, calls, 6 - calls)


def test_what_was_asked_for_longest_ago_goes_first(encode: Encoder):
    memory = BackgroundMemory(2)
    for number in (0, 1, 0, 2, 0):
        memory.maps(cell(number), encode)
    assert (memory.misses, memory.hits) == (3, 2)


def test_other_numbers_of_views_are_other_cells(encode: Encoder):
    memory = BackgroundMemory(2)
    assert len(memory.maps(cell(1, views=4), encode)) == 4
    assert len(memory.maps(cell(1, views=3), encode)) == 3
