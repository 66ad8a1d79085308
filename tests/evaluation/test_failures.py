"""Whose fault it was: grasps counted by object and material."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from neugrasp.data.world import Body, Material, Scene, scene_to_json
from neugrasp.errors import InputError
from neugrasp.evaluation.episode import CRASHED, Episode, write_episode
from neugrasp.evaluation.failures import Aimed, aimed_grasps, failures_table
from neugrasp.robot.pick import COLLISION, SLIPPED, SUCCESS
from neugrasp.simulation.objects import ObjectLibrary
from rounds_by_hand import attempt, played

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
PLACES = ((0.08, 0.08, 0.06), (0.22, 0.22, 0.06))


@pytest.fixture
def lying() -> dict[str, Any]:
    """Two glasses, one of steel, as a round keeps them."""
    names = ObjectLibrary.open(("glassware",)).choices("test", "packed")
    bodies = tuple(Body(*names[i], 1.0, place, UPRIGHT) for i, place in enumerate(PLACES))
    materials = (Material("transparent", "glass", {}), Material("specular", "steel", {}))
    return json.loads(scene_to_json(Scene("packed", 0, bodies, materials)))  # type: ignore[no-any-return]


def evaluation(folder: Path, *episodes: Episode, sets: tuple[str, ...] = ("glassware",)) -> Path:
    folder.mkdir()
    (folder / "run.json").write_text(json.dumps({"object_sets": sets}))
    for episode in episodes:
        write_episode(folder / "rounds" / f"{episode.index:06d}.json", episode)
    return folder


def test_a_grasp_is_counted_for_the_object_that_it_is_at(tmp_path: Path, lying: dict[str, Any]):
    first, second = ((*place[:2], 0.1) for place in PLACES)
    attempts = (
        attempt(0, 0, False, position=second, before=lying, reason=COLLISION),
        attempt(0, 1, True, position=first, before=lying),
        attempt(0, 2, False, position=second, before=lying),
    )
    round_0 = replace(played(0, ""), attempts=attempts)
    others = tuple(replace(one, round=1) for one in attempts)
    crashed = replace(round_0, index=1, attempts=others, ending=CRASHED)
    found = aimed_grasps(evaluation(tmp_path / "out", round_0, crashed))
    names = [body["name"] for body in lying["bodies"]]
    assert found == [
        Aimed(names[1], "specular", COLLISION),
        Aimed(names[0], "transparent", SUCCESS),
        Aimed(names[1], "specular", SLIPPED),
    ]


def test_what_fails_most_stands_first_and_what_never_fails_in_one_line():
    grasps = [Aimed("cup", "transparent", SLIPPED)] * 2 + [Aimed("cup", "specular", SUCCESS)] * 2
    grasps += [Aimed("jar", "transparent", COLLISION)] * 3
    grasps += [Aimed(name, "specular", SUCCESS) for name in ("pot", "pan", "pan")]
    lines = failures_table(grasps).splitlines()
    heads = "grasps | held | % | collision on the way | nothing between the fingers | slipped on lifting"
    assert lines[0] == f"| material | {heads} | carried away from the table |"
    assert lines[2:4] == [
        "| specular | 5 | 5 | 100 | 0 | 0 | 0 | 0 |",
        "| transparent | 5 | 0 | 0 | 3 | 0 | 2 | 0 |",
    ]
    assert lines[7:] == [
        "| jar | 3 | 0 | 0 | 3 | 0 | 0 | 0 |",
        "| cup | 4 | 2 | 50 | 0 | 0 | 2 | 0 |",
        "| 2 others | 3 | 3 | 100 | 0 | 0 | 0 | 0 |",
    ]


def test_what_is_missing_is_named(tmp_path: Path):
    with pytest.raises(InputError, match=r"no evaluation .*run\.json"):
        aimed_grasps(tmp_path)
    with pytest.raises(InputError, match=r"no evaluation .*names no object sets"):
        aimed_grasps(evaluation(tmp_path / "another command's", sets=()))
    with pytest.raises(InputError, match="--objects DIR"):
        aimed_grasps(evaluation(tmp_path / "folder", sets=("folder",)))
    with pytest.raises(InputError, match="round 3 does not say what lay on the table"):
        aimed_grasps(evaluation(tmp_path / "old", played(3, "-")))
