"""The metrics of rounds written by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from neugrasp.errors import InputError
from neugrasp.evaluation.episode import CRASHED, EMPTY, NOTHING_DETECTED, Episode, read_episode, write_episode
from neugrasp.evaluation.protocols import PROTOCOLS
from neugrasp.evaluation.rounds import num_rounds
from neugrasp.evaluation.scores import scores
from neugrasp.metrics import l1_by_mask, wilson_interval
from rounds_by_hand import attempt, played

PAPER, VGN = PROTOCOLS["paper"], PROTOCOLS["vgn"]


def test_rates_are_pooled_over_rounds():
    result = scores([played(0, "+++++"), played(1, "+-+--", 5), played(2, "--", 4)], PAPER)
    assert (result["attempts"], result["successes"], result["objects"], result["rounds"]) == (12, 7, 14, 3)
    assert result["SR"] == pytest.approx(100 * 7 / 12, abs=0.01)
    assert result["FSR"] == pytest.approx(100 * 2 / 3, abs=0.01)
    assert result["DR"] == pytest.approx(100 * 7 / 14)
    for name, part, whole in (("SR", 7, 12), ("FSR", 2, 3)):
        assert result[f"{name}_ci"] == pytest.approx(
            [100 * edge for edge in wilson_interval(part, whole)], abs=0.01
        )


def test_a_round_without_detection_counts_as_a_failed_first_grasp_and_in_dr_as_the_protocol_says():
    rounds = [played(0, "+++++"), played(1, "", ending=NOTHING_DETECTED)]
    assert scores(rounds, PAPER)["FSR"] == scores(rounds, VGN)["FSR"] == 50
    assert scores(rounds, PAPER)["DR"] == 50
    assert scores(rounds, VGN)["DR"] == 100
    assert scores(rounds, PAPER)["SR"] == 100
    assert scores(rounds, PAPER)["endings"][NOTHING_DETECTED] == 1


def test_everything_cleared_is_a_hundred_percent_with_a_one_sided_interval():
    result = scores([played(i, "+++++") for i in range(4)], PAPER)
    assert result["SR"] == result["FSR"] == result["DR"] == 100
    assert result["SR_ci"][1] == 100
    assert result["SR_ci"][0] < 100
    assert result["DR_ci"] == [100, 100]


def test_an_object_that_rolled_away_is_not_declared_grasped():
    rolled = replace(attempt(0, 1, False), lost=1, reason="carried away from the table")
    episode = replace(played(0, "+", 2), attempts=(attempt(0, 0, True), rolled))
    result = scores([episode], PAPER)
    assert (result["DR"], result["SR"], result["lost_objects"]) == (50, 50, 1)
    assert result["failures"]["carried away from the table"] == 1


def test_fewer_than_five_settled_objects_are_the_denominator():
    assert scores([played(0, "+++", 3), played(1, "+-", 1)], PAPER)["DR"] == 100


def test_objects_that_grasps_took_are_counted_by_material():
    def table(kinds: str) -> dict[str, Any]:
        names = {"g": "transparent", "s": "specular"}
        return {"materials": [{"kind": names[kind]} for kind in kinds]}

    attempts = [
        attempt(0, 0, True, before=table("ggss")),
        attempt(0, 1, False, before=table("gss")),
        attempt(0, 2, True, before=table("gss"), lost=1),  # The glass, or what fell down with it?
    ]
    known = Episode(0, 4, EMPTY, tuple(attempts), left=table("s"))
    result = scores([known, played(1, "++")], PAPER)["by_material"]
    assert result["transparent"] == {"objects": 2, "taken": 1, "share": 50.0}
    assert result["specular"] == {"objects": 2, "taken": 0, "share": 0.0}


def test_crashed_rounds_are_named_and_count_nowhere():
    crashed = Episode(7, 0, CRASHED, error="Blender fell over")
    result = scores([played(0, "+-"), crashed], PAPER)
    assert result["crashed"] == [7]
    assert (result["rounds"], result["objects"], result["attempts"]) == (1, 5, 2)


def test_nothing_played_gives_no_rates():
    result = scores([], PAPER)
    assert result["SR"] is result["FSR"] is result["DR"] is result["L1"] is None


def test_the_interval_of_dr_is_that_of_rounds_not_of_objects():
    """Ten rounds, half of them empty-handed: objects of one round stand and fall together."""
    rounds = [played(i, "+++++" if i % 2 else "--") for i in range(10)]
    low, high = scores(rounds, PAPER)["DR_ci"]
    spread = 1.96 * 50 / np.sqrt(10)
    assert low == pytest.approx(50 - spread, abs=6)
    assert high == pytest.approx(50 + spread, abs=6)


def test_l1_is_the_mean_over_grasps():
    def judged(index: int, error: float) -> Episode:
        l1 = {"0.3": error, "1.0": 2 * error}
        constants = {"-1": {"0.3": 0.9, "1.0": 0.5}}
        one = attempt(index, 0, True, l1=l1, l1_constants=constants)
        return replace(played(index, ""), attempts=(one,) * (index + 1))

    result = scores([judged(0, 0.1), judged(1, 0.4)], PAPER)
    assert result["L1"] == pytest.approx(0.3)
    assert result["L1_by_mask"] == pytest.approx({"0.3": 0.3, "1.0": 0.6})
    assert result["L1_constants"]["-1"] == pytest.approx({"0.3": 0.9, "1.0": 0.5})


def test_a_mask_in_which_nothing_lies_is_left_out_and_never_written_as_nan(tmp_path: Path):
    """What is too thin for a voxel has no error under narrow masks; a round that says so is read again."""
    truth = np.ones((8, 8, 8), np.float32)
    truth[0, 0, 0] = -0.2
    assert math.isnan(l1_by_mask(0.0, truth)["0.05"])
    assert l1_by_mask(0.0, truth)["0.3"] == pytest.approx(0.2)
    whole = attempt(0, 0, True, l1={"0.3": 0.2, "0.05": 0.1}, l1_constants={"+0": {"0.3": 0.5, "0.05": 0.3}})
    thin = attempt(1, 0, True, l1={"0.3": 0.4}, l1_constants={"+0": {"0.3": 0.7}})
    nothing = attempt(2, 0, True, l1={}, l1_constants={"+0": {}})
    episodes = [replace(played(i, ""), attempts=(one,)) for i, one in enumerate((whole, thin, nothing))]
    found = scores(episodes, PAPER)
    assert found["L1_by_mask"] == {"0.3": 0.3, "0.05": 0.1}
    assert found["L1_constants"] == {"+0": {"0.3": 0.6, "0.05": 0.3}}
    for i, one in enumerate(episodes):
        write_episode(tmp_path / f"{i}.json", one)
        assert read_episode(tmp_path / f"{i}.json").attempts == one.attempts
    nan = replace(whole, score=math.nan)
    with pytest.raises(ValueError, match="Out of range float"):
        write_episode(tmp_path / "nan.json", replace(episodes[0], attempts=(nan,)))


def test_rounds_come_back_from_disk_as_they_were(tmp_path: Path):
    episode = played(3, "+-+", left={"bodies": []})
    write_episode(tmp_path / "rounds" / "3.json", episode)
    assert read_episode(tmp_path / "rounds" / "3.json") == episode


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"format": "neugrasp-round", "version": 1}'])
def test_a_damaged_round_is_named(tmp_path: Path, text: str):
    path = tmp_path / "3.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"3\.json"):
        read_episode(path)


def test_single_rounds_are_one_for_each_object():
    choices = [("set", str(i)) for i in range(56)]
    assert num_rounds("single", choices, None) == 56
    assert num_rounds("packed", choices, None) == 200
    assert num_rounds("pile", choices, 3) == 3
    with pytest.raises(InputError, match="56 objects"):
        num_rounds("single", choices, 57)
    with pytest.raises(InputError, match="at least 1"):
        num_rounds("pile", choices, 0)
