"""Weights files: what goes in comes out, and nothing else is accepted."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.checkpoint import load_checkpoint, save_checkpoint
from neugrasp.model.network import NeuGrasp
from neugrasp.training.recipes import tiny


@pytest.mark.slow
def test_weights_and_configuration_come_back(model, views, tmp_path):
    save_checkpoint(tmp_path / "a.safetensors", model, {"steps": 3})
    loaded = load_checkpoint(tmp_path / "a.safetensors")
    assert loaded.config == model.config
    assert loaded.about == {"steps": 3}
    with torch.no_grad():
        assert torch.equal(loaded.model()(views)[0].sdf, model(views)[0].sdf)


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": "2"}, "newer"),
        ({"format": "other"}, "not NeuGrasp weights"),
        ({"version": "-1"}, "format version '-1'; this program reads 1"),
        ({"version": "abc"}, "format version 'abc'"),
        ({"version": "9" * 5000}, "format version '9"),
        ({"version": "0"}, "format version '0'"),
        ({"config": '{"colour": 1}'}, "unknown entries"),
        ({"config": "[]"}, "config is not a JSON object|the file is not a JSON object"),
        ({"config": "null"}, "is not a JSON object"),
        ({"config": "{"}, "config: not valid JSON"),
        ({"config": '{"image_size": "x"}'}, "config.image_size is 'x'; it must be a whole number"),
        ({"config": '{"image_size": 0}'}, "config.image_size is 0"),
        ({"config": '{"image_size": 40}'}, "it must be a multiple of 16"),
        ({"config": '{"image_size": true}'}, "config.image_size is True"),
        ({"config": '{"heads": 7}'}, "describes no network .*not a multiple of 7 heads"),
        ({"config": '{"encoder_blocks": [1, 2]}'}, "encoder_blocks has 2 numbers; it must have 3"),
        ({"config": '{"encoder_blocks": [1, 2, 2.5]}'}, "encoder_blocks.2 is 2.5"),
        ({"config": '{"encoder_blocks": [1, 2, 9999]}'}, "encoder_blocks.2 is 9999"),
        ({"config": '{"use_change": 1}'}, "config.use_change is 1; it must be true or false"),
        ({"config": '{"heads": 8, "heads": 4}'}, "'heads' is given twice"),
        ({}, "do not fit|has shape"),
    ],
)
def test_foreign_weights_are_refused_by_name(model, tmp_path, changes, message):
    path = rewritten(tmp_path / "odd.safetensors", model, **changes)
    with pytest.raises(InputError, match=message) as error:
        load_checkpoint(path)
    assert "odd.safetensors" in str(error.value)


@pytest.mark.parametrize(
    ("about", "message"),
    [
        ("[]", "is not a JSON object"),
        ("{", "about: not valid JSON"),
        ('{"threshold": 2}', "about.threshold is 2; it must be a number from 0 to 1"),
        ('{"threshold": "0.9"}', "about.threshold is '0.9'"),
        ('{"threshold": NaN}', "NaN is not a finite number"),
        ('{"recipe": 1}', "about.recipe is 1; it must be a text"),
        ('{"steps": -1}', "about.steps is -1"),
    ],
)
def test_notes_that_the_program_heeds_have_their_type(model, tmp_path, about, message):
    path = tmp_path / "odd.safetensors"
    save_checkpoint(path, model, {})
    config = json.dumps(asdict(model.config))
    rewritten(path, model, about=about, config=config)
    with pytest.raises(InputError, match=message) as error:
        load_checkpoint(path)
    assert "odd.safetensors" in str(error.value)


def test_weights_without_a_configuration_are_refused(model, tmp_path):
    path = tmp_path / "odd.safetensors"
    save_file(dict(model.state_dict()), path, {"format": "neugrasp-weights", "version": "1"})
    with pytest.raises(InputError, match="no config in its metadata"):
        load_checkpoint(path)


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


@pytest.mark.slow
def test_a_detector_takes_the_threshold_that_was_noted_with_its_weights(model, tmp_path):
    save_checkpoint(tmp_path / "judged", model, {"threshold": 0.7})
    save_checkpoint(tmp_path / "plain", model, {})
    assert NeuGraspDetector.load(tmp_path / "judged").selection.threshold == 0.7
    assert NeuGraspDetector.load(tmp_path / "judged", threshold=0.5).selection.threshold == 0.5
    assert NeuGraspDetector.load(tmp_path / "plain").selection.threshold == 0.9


def test_weights_carry_the_cube_that_they_were_trained_for(tmp_path: Path):
    workspace = Workspace(size=0.45, resolution=48, table_height=0.06, truncation=0.04)
    save_checkpoint(tmp_path / "w.safetensors", NeuGrasp(tiny().model, workspace), {})
    assert load_checkpoint(tmp_path / "w.safetensors").model().workspace.cube == workspace.cube


def test_weights_of_before_are_for_the_usual_cube():
    assert load_checkpoint("neugrasp").workspace.cube == Workspace().cube


@pytest.mark.parametrize(
    ("cube", "message"),
    [
        ({"resolution": 41}, "resolution is 41; it must be a multiple of 8"),
        ({"size": -1}, "size is -1"),
        ({"size": "0.3"}, "size is"),
        ({"edge": 1}, "edge is unknown"),
    ],
)
def test_a_cube_that_cannot_be_is_refused(tmp_path: Path, cube: dict[str, object], message: str):
    path = tmp_path / "w.safetensors"
    save_checkpoint(path, NeuGrasp(tiny().model), {})
    with safe_open(path, "pt") as file:
        metadata, tensors = file.metadata(), {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    metadata["workspace"] = json.dumps(json.loads(metadata["workspace"]) | cube)
    save_file(tensors, path, metadata)
    with pytest.raises(InputError, match=message):
        load_checkpoint(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["neugrasp", "neugrasp-evaluator", "graspnerf-tsdf", "vgn"])
def test_loading_leaves_the_compiler_of_pytorch_alone(name: str):
    """Initial values drawn for shapes alone would load it: two seconds at the start of every command."""
    heavy = "{'torch._dynamo', 'sympy'} & {*sys.modules}"
    program = f"import sys, neugrasp as ng; ng.load_detector({name!r}); print({heavy})"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
