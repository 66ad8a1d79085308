"""Lessons for the evaluator of grasps, as the program makes them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from neugrasp.data.lessons import gripper_of, read_lesson
from neugrasp.gripper import gripper_hash

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
    assert gripper_of([tmp_path]) == {"gripper": "panda", "gripper_sha256": gripper_hash("panda")}


@pytest.mark.slow
def test_photos_that_are_not_there_are_named(tmp_path: Path):
    words = [sys.executable, str(PROGRAM), str(tmp_path / "out"), "--photos", str(tmp_path / "nowhere")]
    result = subprocess.run([*words, "--sets", "glassware"], check=False, capture_output=True, text=True)
    assert result.returncode == 1
    assert "nowhere: no records in scenes/" in result.stderr
