"""Points in pieces: the same values and the same gradients, whether pieces are kept or made again."""

from __future__ import annotations

from dataclasses import replace

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


def test_gradients_do_not_depend_on_what_is_kept(
    model: NeuGrasp, views: ViewTensors, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(POINTS, "cpu", 2000)
    other = NeuGrasp(replace(model.config, recompute=True)).eval()
    other.load_state_dict(model.state_dict())
    calls, gradients = [], []
    for network in (model, other):
        forward = network.field.fusion.forward
        monkeypatch.setattr(
            network.field.fusion, "forward", lambda x, f=forward, n=network: calls.append(n) or f(x)
        )
        tsdf = network.reconstruct(
            network.encode(views.images), network.encode(views.backgrounds), views
        ).tsdf
        network.zero_grad()
        tsdf.square().mean().backward()
        gradients.append({name: p.grad for name, p in network.named_parameters() if p.grad is not None})
    assert calls.count(other) == 2 * calls.count(model) > 8
    assert gradients[0].keys() == gradients[1].keys()
    for name, gradient in gradients[0].items():
        torch.testing.assert_close(gradient, gradients[1][name], rtol=1e-4, atol=1e-7)
