"""`neugrasp run` in a twin: it clears a table, tells what it passed over, and outlives being killed."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import pytest

from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.episode import (
    EMPTY,
    GIVEN_UP,
    NOTHING_DETECTED,
    NOTHING_REACHABLE,
    read_episode,
)
from neugrasp.evaluation.run import evaluate
from neugrasp.operation.command import Run
from neugrasp.operation.run import run
from robot_cells import TWIN

pytestmark = pytest.mark.skipif(find_spec("ompl") is None, reason="needs neugrasp[robot]")

ENDINGS = (EMPTY, NOTHING_DETECTED, NOTHING_REACHABLE, GIVEN_UP)
KILLS = 20


def few(folder: Path) -> Path:
    """The example with two objects."""
    path = folder / "cell.toml"
    path.write_text(TWIN.read_text().replace("objects = 5", "objects = 2"))
    return path


@pytest.mark.slow
def test_a_table_is_cleared_and_the_record_is_that_of_a_round(tmp_path: Path):
    config = Run(few(tmp_path), tmp_path / "run", detector="oracle")
    said = run(config)
    episode = read_episode(tmp_path / "run/rounds/000000.json")
    assert episode.ending in ENDINGS
    assert episode.objects == 2
    assert f"{episode.successes} of 2 objects with {len(episode.attempts)} picks" in said
    assert said.splitlines()[-1].startswith("next: neugrasp view ")
    assert run(config).splitlines()[0] == said.splitlines()[0]
    with pytest.raises(InputError, match="give the same options"):
        run(replace(config, strategy="random"))


@pytest.mark.slow
def test_whatever_kills_it_the_same_command_goes_on(tmp_path: Path):
    """Twenty times by SIGKILL, at random moments of a run that begins again where it was."""
    words = ["run", str(few(tmp_path)), "--out", str(tmp_path / "run"), "--detector", "oracle"]
    file, rng, attempts = tmp_path / "run/rounds/000000.json", random.Random(0), 0
    for _ in range(KILLS):
        process = subprocess.Popen([sys.executable, "-m", "neugrasp", *words], stderr=subprocess.DEVNULL)
        time.sleep(rng.uniform(1, 9))
        process.kill()
        process.wait()
        if file.is_file():
            episode = read_episode(file)
            assert [attempt.attempt for attempt in episode.attempts] == list(range(len(episode.attempts)))
            assert len(episode.attempts) >= attempts
            attempts = len(episode.attempts)
    subprocess.run([sys.executable, "-m", "neugrasp", *words], check=True, capture_output=True)
    episode = read_episode(file)
    assert episode.ending in ENDINGS
    assert episode.attempts[0].objects == 2
    taken = episode.successes + sum(attempt.lost for attempt in episode.attempts)
    assert episode.left is not None
    assert len(episode.left["bodies"]) == 2 - taken


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"speed": 0.0}, "--speed 0.0; it must be above 0, and at most 1"),
        ({"speed": 2.0}, "--speed 2.0"),
        ({"max_failures": 0}, "--max-failures 0; it must be at least 1"),
    ],
)
def test_options_that_cannot_be_are_refused(tmp_path: Path, change: dict[str, float], words: str):
    with pytest.raises(InputError, match=words):
        run(replace(Run(TWIN, tmp_path), **change))  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_cell_in_which_something_is_wrong_is_not_run(tmp_path: Path):
    path = tmp_path / "cell.toml"
    path.write_text(TWIN.read_text().replace("drop = [110.0,", "drop = [178.0,"))
    with pytest.raises(InputError, match=r"over the workspace.*neugrasp cell check"):
        run(Run(path, tmp_path / "run"))


def test_rounds_of_a_cell_take_its_gripper_and_no_other(tmp_path: Path):
    asked = Evaluate(out=tmp_path, cell=TWIN, gripper="robotiq_2f85", views="ring6")
    with pytest.raises(InputError, match="--views ring6: the cell file says released"):
        evaluate(asked)
