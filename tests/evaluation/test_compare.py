"""Paired comparison, and what is printed of an evaluation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from neugrasp.errors import InputError
from neugrasp.evaluation.compare import compare
from neugrasp.evaluation.episode import CRASHED, Episode, write_episode
from neugrasp.evaluation.tables import comparison_table, metrics_table
from rounds_by_hand import FACTS, metrics, played


def evaluation(folder: Path, episodes: list[Episode], **changes: Any) -> Path:
    folder.mkdir()
    (folder / "run.json").write_text(json.dumps(FACTS | changes))
    for episode in episodes:
        write_episode(folder / "rounds" / f"{episode.index:06d}.json", episode)
    return folder


def outcomes(rng: np.random.Generator, rate: float, count: int) -> list[Episode]:
    return [played(i, "".join(rng.choice(["+", "-"], 5, p=[rate, 1 - rate]))) for i in range(count)]


def test_an_evaluation_does_not_differ_from_itself(tmp_path: Path, rng: np.random.Generator):
    a = evaluation(tmp_path / "a", outcomes(rng, 0.5, 20))
    result = compare(a, a)
    assert result["rounds"] == 20
    for name in ("SR", "FSR", "DR"):
        assert result[name]["difference"] == 0
        assert result[name]["ci"] == [0, 0]
        assert result[name]["p"] == 1


@pytest.mark.slow
def test_a_large_difference_is_no_chance(tmp_path: Path, rng: np.random.Generator):
    a = evaluation(tmp_path / "a", outcomes(rng, 0.3, 40))
    b = evaluation(tmp_path / "b", outcomes(rng, 0.8, 40))
    result = compare(a, b)
    assert result["SR"]["difference"] == pytest.approx(50, abs=15)
    assert result["SR"]["p"] < 0.001
    assert result["SR"]["ci"][0] > 0
    turned = compare(b, a)
    assert turned["SR"]["difference"] == -result["SR"]["difference"]
    assert "+" in comparison_table(result)


@pytest.mark.slow
def test_p_is_uniform_where_there_is_no_difference(tmp_path: Path):
    """Of forty pairs of equals, about four have p < 0.1."""
    rng, found = np.random.default_rng(3), []
    for i in range(40):
        a = evaluation(tmp_path / f"a{i}", outcomes(rng, 0.5, 12))
        b = evaluation(tmp_path / f"b{i}", outcomes(rng, 0.5, 12))
        found.append(compare(a, b)["DR"]["p"])
    assert 0 <= np.count_nonzero(np.array(found) < 0.1) <= 10
    assert 0.3 < np.mean(found) < 0.7


def test_only_rounds_that_both_played_are_compared(tmp_path: Path):
    a = evaluation(tmp_path / "a", [played(0, "+"), played(1, "+"), Episode(2, 0, CRASHED)])
    b = evaluation(tmp_path / "b", [played(0, "-"), played(2, "-")])
    result = compare(a, b)
    assert result["rounds"] == 1
    assert result["SR"]["difference"] == -100


@pytest.mark.parametrize("key", ["protocol", "scene", "seed", "objects_sha256"])
def test_evaluations_of_other_rounds_are_refused(tmp_path: Path, key: str):
    a = evaluation(tmp_path / "a", [played(0, "+")])
    b = evaluation(tmp_path / "b", [played(0, "+")], **{key: "another"})
    with pytest.raises(InputError, match=key):
        compare(a, b)


def test_scenes_that_differ_are_refused(tmp_path: Path):
    from dataclasses import replace

    a = evaluation(tmp_path / "a", [played(0, "+")])
    b = evaluation(tmp_path / "b", [replace(played(0, "+"), scene_sha256="other")])
    with pytest.raises(InputError, match="round 0 began with another scene"):
        compare(a, b)


def test_the_table_of_a_run_names_crashes():
    told = metrics_table(metrics([played(0, "+"), Episode(4, 0, CRASHED)]))
    assert "CRASHED, counted nowhere: rounds 4" in told
    assert "1 of 1 grasps" in told


def test_rounds_that_are_not_those_of_their_files_are_refused(tmp_path: Path):
    a, b = (evaluation(tmp_path / name, [played(0, "+"), played(1, "+-")]) for name in "ab")
    rounds = b / "rounds"
    (rounds / "000001.json").rename(rounds / "000002.json")
    with pytest.raises(InputError, match=r"000002\.json: is of round 1"):
        compare(a, b)
    content = json.loads((rounds / "000002.json").read_text())
    (rounds / "000002.json").write_text(json.dumps({**content, "index": 2}))
    with pytest.raises(InputError, match=r"000002\.json: attempts\[0\] is attempt 0 of round 1"):
        compare(a, b)
