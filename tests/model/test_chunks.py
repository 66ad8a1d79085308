"""Points in pieces: the same values and the same gradients, however large they are."""

from __future__ import annotations

import pytest
import torch

from neugrasp.model.chunks import POINTS, in_chunks
from neugrasp.model.inputs import ViewTensors
from neugrasp.model.network import NeuGrasp

CPU = torch.device("cpu")


@pytest.mark.parametrize("num", [1, 7, 8, 30])
def test_pieces_cover_everything_once_in_order(monkeypatch: pytest.MonkeyPatch, num: int):
    monkeypatch.setitem(POINTS, "cpu", 8)
    with torch.no_grad():
        pieces = in_chunks(lambda start, stop: list(range(start, stop)), num, CPU, points_each=3)
    assert [i for piece in pieces for i in piece] == list(range(num))
    assert max(map(len, pieces)) == min(2, num)


def test_values_and_gradients_do_not_depend_on_the_pieces(
    model: NeuGrasp, views: ViewTensors, monkeypatch: pytest.MonkeyPatch
):
    grids, gradients = [], []
    for points in (500, 2**20):
        monkeypatch.setitem(POINTS, "cpu", points)
        model.zero_grad()
        tsdf = model.reconstruct(model.encode(views.images), model.encode(views.backgrounds), views).tsdf
        tsdf.square().mean().backward()
        grids.append(tsdf.detach())
        gradients.append({name: p.grad for name, p in model.named_parameters() if p.grad is not None})
    torch.testing.assert_close(*grids)
    assert gradients[0].keys() == gradients[1].keys()
    for name, gradient in gradients[0].items():
        torch.testing.assert_close(gradient, gradients[1][name], rtol=1e-4, atol=1e-7)
