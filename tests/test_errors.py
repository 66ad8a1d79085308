"""Missing and broken extras are told apart, each with what to do."""

from __future__ import annotations

import io
import logging
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import neugrasp
from neugrasp.data.records import read_record
from neugrasp.data.scene_sets import open_scenes
from neugrasp.errors import BrokenExtra, MissingExtra, NeuGraspError, require, told_as
from neugrasp.model.evaluator_file import load_evaluator
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.terminal import TerminalLog, printable


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


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b[2Jwiped\x1b]0;title\x07", r"\x1b[2Jwiped\x1b]0;title\x07"),
        ("back\b\rspace", r"back\x08\rspace"),
        ("\x9b31mred", r"\x9b31mred"),
        ("\u202egnp.exe", r"\u202egnp.exe"),
        ("half \ud800 a letter", r"half \ud800 a letter"),
        ("\udcff of a name that is no UTF-8", r"\udcff of a name that is no UTF-8"),
        ("line\u2028end", r"line\u2028end"),
        ("zwei Zeilen\n\täöü 日本 😀", "zwei Zeilen\n\täöü 日本 😀"),
    ],
)
def test_nothing_from_a_file_steers_a_terminal(text: str, shown: str):
    assert printable(text, io.TextIOWrapper(io.BytesIO(), encoding="utf-8")) == shown


def test_a_terminal_without_a_letter_gets_its_number():
    assert printable("süß", io.TextIOWrapper(io.BytesIO(), encoding="ascii")) == r"s\xfc\xdf"


def test_messages_are_escaped_and_a_warning_is_told_once():
    stream = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    logger = logging.Logger("test")
    logger.addHandler(TerminalLog(stream))
    for _ in range(2):
        logger.warning("%s: odd", "a\x1b[2J")
        logger.info("step")
    stream.seek(0)
    assert stream.read() == "a\\x1b[2J: odd\nstep\nstep\n"


@pytest.mark.blender
def test_the_system_has_what_blender_needs():
    """Fails with the loader's own words where a system library is missing."""
    result = subprocess.run([sys.executable, "-c", "import bpy"], check=False, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    ("call", "kind"),
    [
        (lambda: neugrasp.read_scene("nowhere"), neugrasp.SceneError),
        (lambda: neugrasp.load_detector("neugrasp", weights="nowhere"), neugrasp.WeightsError),
        (lambda: neugrasp.Gripper.load("nowhere"), neugrasp.GripperFileError),
        (lambda: open_scenes(Path("nowhere")), neugrasp.DataError),
        (lambda: read_record(Path("nowhere")), neugrasp.DataError),
        (lambda: ObjectLibrary.open(["nowhere"]), neugrasp.ObjectError),
        (lambda: load_evaluator("nowhere"), neugrasp.WeightsError),
    ],
)
def test_what_cannot_be_used_says_of_what_kind_it_is(call: Callable[[], object], kind: type[Exception]):
    with pytest.raises(neugrasp.InputError, match="nowhere") as caught:
        call()
    assert type(caught.value) is kind


def test_an_error_is_told_as_another_kind_with_its_words():
    for first, second in (
        (neugrasp.InputError, neugrasp.SceneError),
        (neugrasp.SceneError, neugrasp.DataError),
    ):
        with pytest.raises(second, match="three words here"), told_as(second):
            raise first("three words here")
    with pytest.raises(KeyError), told_as(neugrasp.DataError):
        raise KeyError("not a user's")
