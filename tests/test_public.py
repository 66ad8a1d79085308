"""The public face: lazy names, and nothing heavy until one of them is used."""

from __future__ import annotations

import subprocess
import sys

import pytest

import neugrasp as ng


@pytest.mark.parametrize("name", ng.__all__)
def test_public_names_are_there_and_described(name: str):
    assert getattr(ng, name).__doc__
    assert name in dir(ng)


def test_all_of_them_have_a_home_and_a_type():
    assert sorted(ng._HOMES) == ng.__all__ == sorted(ng.__all__)


def test_what_is_not_public_is_no_attribute():
    with pytest.raises(AttributeError, match="has no attribute 'Grapsp'"):
        _ = ng.Grapsp


@pytest.mark.slow
def test_a_client_of_detections_needs_no_torch():
    code = "import sys, neugrasp as ng; ng.Detection, ng.Observation; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_detector_by_name_by_weights_or_of_ones_own():
    assert isinstance(ng.load_detector(threshold=0.5), ng.NeuGraspDetector)
    assert ng.load_detector().judge is not None
    assert ng.load_detector("neugrasp").judge is None
    assert ng.load_detector("neugrasp-tsdf", gripper="robotiq_2f85").gripper.name == "robotiq_2f85"
    assert type(ng.load_detector("toy_detector:SPEC")).__name__ == "Downwards"
    with pytest.raises(ng.InputError, match="no weights 'nothing'"):
        ng.load_detector("nothing")
    with pytest.raises(TypeError, match="grippr"):
        ng.load_detector("neugrasp", grippr="panda")


@pytest.mark.slow
def test_importing_it_loads_neither_torch_nor_jaxtyping():
    code = "import sys, neugrasp; sys.exit(bool({'torch', 'jaxtyping', 'numpy'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.slow
def test_tests_alone_check_shapes():
    code = (
        "import sys, neugrasp.model.network, neugrasp.detection.detector, neugrasp.training.module\n"
        "sys.exit('beartype' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
