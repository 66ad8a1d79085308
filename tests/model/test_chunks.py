"""Points in pieces: the same values and the same gradients, however large they are."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import pytest
import torch

from neugrasp.model.chunks import POINTS, in_chunks, in_threads
from neugrasp.model.inputs import ViewTensors
from neugrasp.model.network import NeuGrasp

CPU = torch.device("cpu")


@contextmanager
def computing_with(threads: int) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("num", [1, 7, 8, 30])
def test_pieces_cover_everything_once_in_order(monkeypatch: pytest.MonkeyPatch, num: int, threads: int):
    monkeypatch.setitem(POINTS, "cpu", 8)
    sizes = []

    def piece(start: int, stop: int) -> tuple[torch.Tensor, ...]:
        sizes.append(stop - start)
        return (torch.arange(start, stop),)

    with computing_with(threads):
        (result,) = in_chunks(piece, num, CPU, points_each=3, learns=())
        assert torch.get_num_threads() == threads
    assert result.tolist() == list(range(num))
    assert max(sizes) <= 2


def test_threads_share_precision_mode_and_context_and_pass_errors_on():
    setting = ContextVar("setting", default=0)
    setting.set(7)

    def seen(index: int) -> tuple[int, bool, torch.dtype, int]:
        if index == 5:
            raise ValueError("five")
        product = torch.ones(2, 2) @ torch.ones(2, 2)
        return torch.get_num_threads(), torch.is_grad_enabled(), product.dtype, setting.get()

    with computing_with(2), torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        assert set(in_threads(seen, range(4), 2)) == {(1, False, torch.bfloat16, 7)}
        with pytest.raises(ValueError, match="five"):
            in_threads(seen, range(6), 2)
        assert torch.get_num_threads() == 2


@pytest.mark.parametrize("threads", [1, 2])
def test_gradients_of_pieces_are_those_of_the_whole(monkeypatch: pytest.MonkeyPatch, threads: int):
    """Through what all pieces share and what each has for itself; what is not asked for gets none."""
    monkeypatch.setitem(POINTS, "cpu", 2)
    torch.manual_seed(0)
    weight, bias, own = (
        torch.randn(4, 3).requires_grad_(),
        torch.randn(3).requires_grad_(),
        torch.randn(20, 4),
    )
    own, unused = own.requires_grad_(), torch.ones(1, requires_grad=True)

    def piece(start: int, stop: int) -> tuple[torch.Tensor, ...]:
        inner = own[start:stop] @ weight
        return inner.exp(), torch.arange(start, stop), inner + bias

    with computing_with(threads):
        first, places, second = in_chunks(piece, 20, CPU, 1, [weight, bias, own, unused])
        gradients = torch.autograd.grad(
            (first * second).sum(), [weight, bias, own, unused], allow_unused=True
        )
        only_one = in_chunks(piece, 20, CPU, 1, [weight, bias, own])[2].sum()
        torch.testing.assert_close(torch.autograd.grad(only_one, bias)[0], torch.full((3,), 20.0))
    assert not places.requires_grad
    inner = own @ weight
    truth = torch.autograd.grad((inner.exp() * (inner + bias)).sum(), [weight, bias, own])
    assert gradients[3] is None
    for gradient, same in zip(gradients, truth, strict=False):
        torch.testing.assert_close(gradient, same)


@pytest.mark.parametrize("threads", [1, 2])
def test_values_and_gradients_do_not_depend_on_the_pieces(
    model: NeuGrasp, views: ViewTensors, monkeypatch: pytest.MonkeyPatch, threads: int
):
    grids, gradients = [], []
    for points in (500, 2**20):
        monkeypatch.setitem(POINTS, "cpu", points)
        model.zero_grad()
        with computing_with(threads):
            tsdf = model.reconstruct(model.encode(views.images), model.encode(views.backgrounds), views).tsdf
            tsdf.square().mean().backward()
        grids.append(tsdf.detach())
        gradients.append({name: p.grad for name, p in model.named_parameters() if p.grad is not None})
    torch.testing.assert_close(*grids)
    assert gradients[0].keys() == gradients[1].keys()
    for name, gradient in gradients[0].items():
        torch.testing.assert_close(gradient, gradients[1][name], rtol=1e-4, atol=1e-7)
