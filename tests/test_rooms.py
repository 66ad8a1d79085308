"""How far a reader has to walk: which packages photos pass through, and a round of the benchmark."""

from __future__ import annotations

import sys
from pathlib import Path
from types import FrameType

import pytest

import neugrasp
from neugrasp.cli import main
from neugrasp.demo.bundled import demo_scenes

HOME = Path(neugrasp.__file__).parent


def packages_entered(arguments: list[str]) -> set[str]:
    """The packages of which any function runs during a command."""
    entered: set[str] = set()

    def note(frame: FrameType, event: str, _argument: object) -> None:
        file = Path(frame.f_code.co_filename)
        if event == "call" and frame.f_code.co_name != "<module>" and file.is_relative_to(HOME):
            entered.add(file.relative_to(HOME).parts[0])

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        assert main(arguments) == 0
    finally:
        sys.setprofile(before)
    return {name for name in entered if not name.endswith(".py")}


@pytest.mark.slow
def test_photos_pass_through_ten_packages_at_most(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    entered = packages_entered(["predict", str(demo_scenes()[0].folder), "--out", str(tmp_path / "p.json")])
    assert {"data", "doctor", "model", "detection"} < entered
    assert len(entered) <= 10, sorted(entered)
    assert "next:" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.blender
def test_a_round_of_the_benchmark_passes_through_twelve_at_most(tmp_path: Path):
    run = ["evaluate", "--rounds", "1", "--samples", "1", "--out", str(tmp_path / "rounds")]
    entered = packages_entered(run)
    assert {"simulation", "evaluation", "detection"} < entered
    assert len(entered) <= 12, sorted(entered)
