"""Operations and bytes, where they are known."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from neugrasp.bench.counting import FlopCounter, Kept, num_bytes
from neugrasp.bench.machine import Rates
from neugrasp.bench.recorder import Cost, Part, Recorder, watched
from reference_network.attention import PlainEncoderLayer

CPU = torch.device("cpu")


class Two(nn.Module):
    """Two layers, one called from within the other's stage."""

    def __init__(self) -> None:
        super().__init__()
        self.first = nn.Linear(8, 16)
        self.second = nn.Linear(16, 4, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        return self.second(self.first(x)) * 2

    def twice(self, x: Tensor) -> Tensor:
        return self(self(x)[:, [0, 1, 2, 3] * 2])


PARTS = (Part("all", "forward"), Part("first", "first.forward", "first"))


def counted(network: nn.Module, parts: tuple[Part, ...], x: Tensor) -> dict[str, Cost]:
    counter = FlopCounter()
    recorder = Recorder(CPU, counter)
    with watched(network, parts, recorder), counter:
        network(x)
    return recorder.costs()


@torch.no_grad()
def test_products_are_counted_for_the_stage_that_makes_them():
    costs = counted(Two(), PARTS, torch.ones(10, 8))
    assert costs["first"].flops == {"float32": 2 * 10 * 8 * 16}
    assert costs["all"].flops["float32"] == 2 * 10 * 16 * 4
    assert costs["first"].seconds > 0
    assert costs["all"].seconds > 0


@torch.no_grad()
def test_bytes_are_inputs_outputs_and_weights_each_once():
    network, x = Two(), torch.ones(10, 8)
    costs = counted(network, (Part("all", "forward", "second"), *PARTS[1:]), x)
    assert costs["first"].num_bytes == 4 * (10 * 8 + 8 * 16 + 16 + 10 * 16)
    # Its own input and output, and its weights; what the first layer gave is no traffic with the outside.
    assert costs["all"].num_bytes == 4 * (10 * 8 + 16 * 4 + 10 * 4)


@torch.no_grad()
def test_bfloat16_is_counted_apart_and_has_its_own_roofline():
    with torch.autocast("cpu", torch.bfloat16):
        cost = counted(Two(), PARTS, torch.ones(10, 8))["first"]
    assert cost.flops == {"bfloat16": 2 * 10 * 8 * 16}
    rates = Rates({"float32": 1e9, "bfloat16": 4e9}, copy=1e12)
    assert rates.roofline(cost) == 2 * 10 * 8 * 16 / 4e9
    assert Rates({"bfloat16": 1e15}, copy=1e3).roofline(cost) == cost.num_bytes / 1e3


def test_convolutions_and_backward_passes_are_counted():
    counter = FlopCounter()
    x = torch.ones(1, 3, 8, 8, requires_grad=True)
    with counter:
        nn.Conv2d(3, 5, 3, padding=1, bias=False)(x).sum().backward()
    forward = 2 * 64 * 3 * 5 * 9
    assert counter.flops[torch.float32] == 3 * forward


@torch.no_grad()
def test_attention_costs_its_layers_and_its_sums():
    """Six layers of d x d for every token, and the sums over heads that linear attention is made of."""
    points, tokens, dim, heads = 7, 5, 12, 3
    counter = FlopCounter()
    with counter:
        PlainEncoderLayer(dim, heads)(torch.ones(points, tokens, dim))
    layers = points * tokens * (4 * dim**2 + 4 * dim**2 + 2 * dim**2)
    sums = 2 * points * tokens * dim * (dim // heads)
    assert counter.flops[torch.float32] >= 2 * (layers + sums)
    assert counter.flops[torch.float32] < 2.2 * (layers + sums)


@torch.no_grad()
def test_a_stage_within_one_of_the_same_weights_belongs_to_it():
    network = Two()
    parts = (Part("twice", "twice", ""), Part("once", "forward", ""))
    recorder = Recorder(CPU)
    with watched(network, parts, recorder):
        network.twice(torch.ones(2, 8))
    assert list(recorder.costs()) == ["twice"]


def test_nothing_is_left_behind():
    network = Two()
    with watched(network, PARTS, Recorder(CPU)):
        assert "forward" in vars(network)
    assert "forward" not in vars(network)
    assert "forward" not in vars(network.first)


def test_views_of_one_place_count_once():
    x = torch.ones(4, 4)
    assert num_bytes([x, x.reshape(16), torch.ones(2)]) == 64 + 8
    assert num_bytes([x], known=[x]) == 0


def test_what_is_kept_for_the_backward_pass():
    weight = nn.Parameter(torch.ones(8, 8))
    kept = Kept([weight])
    x = torch.ones(3, 8)
    with kept.watching():
        loss = ((x @ weight) ** 2).sum()
    # The product keeps x, the square its own input; the weight is no activation.
    assert kept.num_bytes == 4 * (3 * 8 + 3 * 8)
    loss.backward()
    assert weight.grad is not None
