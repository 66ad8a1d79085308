"""Missing and broken extras are told apart, each with what to do."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from neugrasp.errors import BrokenExtra, MissingExtra, NeuGraspError, require


def test_a_module_that_is_there_is_given():
    assert require("json", "sim").dumps([]) == "[]"


def test_a_missing_module_names_the_command_that_installs_it():
    with pytest.raises(
        MissingExtra, match=r"'no_such_module' is not installed. Run: pip install 'neugrasp\[sim\]'"
    ):
        require("no_such_module", "sim")


@pytest.mark.parametrize(
    "code", ["raise ImportError('libXi.so.6: cannot open shared object file')", "import no_such_dependency"]
)
def test_a_module_that_does_not_load_is_not_called_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str
):
    (tmp_path / "broken_module.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(BrokenExtra, match=r"is installed but cannot be loaded: .*apt install libx11-6"):
        require("broken_module", "render")


def test_a_user_can_catch_all_of_them():
    assert issubclass(MissingExtra, NeuGraspError)
    assert issubclass(BrokenExtra, NeuGraspError)


@pytest.mark.blender
def test_the_system_has_what_blender_needs():
    """Fails with the loader's own words where a system library is missing."""
    result = subprocess.run([sys.executable, "-c", "import bpy"], check=False, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
