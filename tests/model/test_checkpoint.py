"""Weights files: what goes in comes out, and nothing else is accepted."""

from __future__ import annotations

import json

import pytest
import torch
from safetensors.torch import load_file, save_file

from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.errors import InputError
from neugrasp.model.checkpoint import load_checkpoint, save_checkpoint


def test_weights_and_configuration_come_back(model, views, tmp_path):
    save_checkpoint(tmp_path / "a.safetensors", model, {"steps": 3})
    loaded = load_checkpoint(tmp_path / "a.safetensors")
    assert loaded.config == model.config
    assert loaded.about == {"steps": 3}
    with torch.no_grad():
        assert torch.equal(loaded.model()(views)[0].sdf, model(views)[0].sdf)


def test_half_precision_is_half_the_size_and_nearly_the_same(model, views, tmp_path):
    for name, half in (("whole", False), ("half", True)):
        save_checkpoint(tmp_path / name, model, {}, half=half)
    assert (tmp_path / "half").stat().st_size < 0.7 * (tmp_path / "whole").stat().st_size
    with torch.no_grad():
        difference = load_checkpoint(tmp_path / "half").model()(views)[0].sdf - model(views)[0].sdf
    assert difference.abs().max() < 0.05


def rewritten(path, model, **changes: str):
    metadata = {"format": "neugrasp-weights", "version": "1", "config": json.dumps({}), "about": "{}"}
    save_file(dict(model.state_dict()), path, {**metadata, **changes})
    return path


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": "2"}, "newer"),
        ({"format": "other"}, "not NeuGrasp weights"),
        ({"config": '{"colour": 1}'}, "unknown entries"),
        ({}, "do not fit|has shape"),
    ],
)
def test_foreign_weights_are_refused_by_name(model, tmp_path, changes, message):
    path = rewritten(tmp_path / "odd.safetensors", model, **changes)
    with pytest.raises(InputError, match=message) as error:
        load_checkpoint(path)
    assert "odd.safetensors" in str(error.value)


def test_a_cut_file_is_refused(model, tmp_path):
    path = tmp_path / "cut.safetensors"
    save_checkpoint(path, model, {})
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"cut\.safetensors: not a readable"):
        load_checkpoint(path)


def test_nan_is_refused(model, tmp_path):
    path = tmp_path / "nan.safetensors"
    next(model.parameters()).data[0] = float("nan")
    save_checkpoint(path, model, {})
    assert any(tensor.isnan().any() for tensor in load_file(path).values())
    with pytest.raises(InputError, match="NaN"):
        load_checkpoint(path)


def test_unknown_weights_name_the_ones_there_are():
    with pytest.raises(InputError, match="neither a file nor one of the shipped weights"):
        load_checkpoint("no-such-weights")


def test_a_detector_takes_the_threshold_that_was_noted_with_its_weights(model, tmp_path):
    save_checkpoint(tmp_path / "judged", model, {"threshold": 0.7})
    save_checkpoint(tmp_path / "plain", model, {})
    assert NeuGraspDetector.load(tmp_path / "judged").selection.threshold == 0.7
    assert NeuGraspDetector.load(tmp_path / "judged", threshold=0.5).selection.threshold == 0.5
    assert NeuGraspDetector.load(tmp_path / "plain").selection.threshold == 0.9
