"""Points in pieces: the same values and the same gradients, however large the pieces are."""

from __future__ import annotations

import pytest
import torch

from neugrasp.model import chunked
from neugrasp.model.chunked import map_chunked
from neugrasp.model.inputs import ViewTensors
from neugrasp.model.network import NeuGrasp

CPU = torch.device("cpu")


@pytest.mark.parametrize("num", [1, 7, 8, 30])
def test_pieces_cover_everything_once_in_order(monkeypatch: pytest.MonkeyPatch, num: int):
    monkeypatch.setattr(chunked, "CPU_POINTS", 8)
    monkeypatch.setattr(chunked, "WITH_GRADIENT", 1)
    sizes = []

    def piece(part: slice) -> tuple[torch.Tensor, ...]:
        sizes.append(part.stop - part.start)
        return (torch.arange(part.start, part.stop),)

    (result,) = map_chunked(piece, num, 3, CPU)
    assert result.tolist() == list(range(num))
    assert max(sizes) <= 2


def test_other_devices_take_everything_at_once():
    parts: list[slice] = []
    map_chunked(lambda part: (parts.append(part), torch.ones(part.stop))[1:], 10**6, 40, torch.device("meta"))
    assert parts == [slice(0, 10**6)]


@pytest.mark.slow
def test_values_and_gradients_do_not_depend_on_the_pieces(
    model: NeuGrasp, views: ViewTensors, monkeypatch: pytest.MonkeyPatch
):
    grids, gradients = [], []
    for points in (500, 2**20):
        monkeypatch.setattr(chunked, "CPU_POINTS", points)
        model.zero_grad()
        tsdf = model.reconstruct(model.encode(views.images), model.encode(views.backgrounds), views).tsdf
        tsdf.square().mean().backward()
        grids.append(tsdf.detach())
        gradients.append({name: p.grad for name, p in model.named_parameters() if p.grad is not None})
    torch.testing.assert_close(*grids)
    assert gradients[0].keys() == gradients[1].keys()
    for name, gradient in gradients[0].items():
        torch.testing.assert_close(gradient, gradients[1][name], rtol=1e-4, atol=1e-7)
