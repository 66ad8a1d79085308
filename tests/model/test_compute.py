"""Where PyTorch computes is checked before anything is loaded."""

from __future__ import annotations

import pytest
import torch

from neugrasp.errors import InputError
from neugrasp.model.compute import Compute


def test_precision_is_that_of_products():
    pair = torch.ones(2, 2)
    with Compute.of("cpu", "bfloat16").autocast():
        assert (pair @ pair).dtype == torch.bfloat16
    with Compute.of("cpu").autocast():
        assert (pair @ pair).dtype == torch.float32


@pytest.mark.parametrize(
    ("device", "precision", "words"),
    [
        ("tpu", "float32", "--device tpu: PyTorch knows no such device"),
        ("meta", "float32", "--device meta: nothing can be computed there; try cpu or cuda"),
        ("cpu", "float8", "--precision float8: choose one of float32, bfloat16"),
    ],
)
def test_names_that_are_none(device: str, precision: str, words: str):
    with pytest.raises(InputError, match=words):
        Compute.of(device, precision)


@pytest.mark.parametrize(("count", "device", "words"), [(0, "cuda", "none here"), (2, "cuda:2", "2 of them")])
def test_devices_that_are_not_there(count: int, device: str, words: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)
    with pytest.raises(InputError, match=f"--device {device}: PyTorch sees {words}"):
        Compute.of(device)
