"""Lessons for the evaluator of grasps, as the program makes them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from neugrasp.data.lessons import gripper_of, read_lesson
from neugrasp.gripper import Gripper

PROGRAM = Path(__file__).parents[2] / "benchmarks" / "evaluator_lessons.py"


@pytest.mark.slow
def test_scenes_are_cleared_and_a_stopped_run_goes_on(tmp_path: Path):
    words = [PROGRAM, tmp_path, "--scene", "single", "--draws", "12", "--sets", "glassware", "--seed", "3"]
    for num in ("1", "2"):
        subprocess.run([sys.executable, *map(str, words), "--num", num], check=True, cwd=PROGRAM.parent)
        times = [file.stat().st_mtime_ns for file in sorted(tmp_path.glob("*.npz"))]
        assert len(times) == int(num)
    lesson = read_lesson(tmp_path / "single-3-000000.npz")
    assert len(lesson) > 0
    assert not (lesson.success & ~lesson.free).any()
    assert gripper_of(tmp_path).to_dict() == Gripper.load("panda").to_dict()


@pytest.mark.slow
def test_grippers_that_nobody_built_try_grasps(tmp_path: Path):
    """Of 40, all are grippers; one of them makes a lesson."""
    made = tmp_path / "grippers"
    words = [sys.executable, str(PROGRAM.with_name("sampled_grippers.py")), str(made), "--num", "40"]
    subprocess.run(words, check=True, capture_output=True)
    grippers = [Gripper.load(file) for file in sorted(made.glob("*.json"))]
    assert len({gripper.max_opening for gripper in grippers}) == 40
    lessons = [
        str(PROGRAM),
        str(tmp_path / "out"),
        "--scene",
        "single",
        "--draws",
        "8",
        "--sets",
        "glassware",
    ]
    lessons += ["--num", "1", "--first", "2", "--gripper", str(sorted(made.glob("*.json"))[3])]
    subprocess.run([sys.executable, *lessons], check=True, cwd=PROGRAM.parent)
    assert gripper_of(tmp_path / "out").to_dict() == grippers[3].to_dict()
    assert [file.name for file in (tmp_path / "out").glob("*.npz")] == ["single-1000-000002.npz"]


@pytest.mark.slow
def test_photos_that_are_not_there_are_named(tmp_path: Path):
    words = [sys.executable, str(PROGRAM), str(tmp_path / "out"), "--photos", str(tmp_path / "nowhere")]
    result = subprocess.run([*words, "--sets", "glassware"], check=False, capture_output=True, text=True)
    assert result.returncode == 1
    assert "nowhere: no records in scenes/" in result.stderr
