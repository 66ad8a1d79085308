"""The folder that `neugrasp evaluate` writes, as later commands read it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from neugrasp.errors import InputError
from neugrasp.evaluation.episode import CRASHED, Episode, read_episode
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.scene import Scene, scene_from_json


def facts_of(folder: Path) -> dict[str, Any]:
    """What the rounds of an evaluation depend on. Raises `InputError` where there is no evaluation."""
    path = folder / "run.json"
    try:
        facts: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{folder}: no evaluation ({error.strerror}: run.json)") from error
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: not valid JSON ({error})") from error
    return facts


def played(folder: Path) -> list[Episode]:
    """Its rounds in order, without those that crashed. Raises `InputError` where one is damaged."""
    episodes = map(read_episode, sorted((folder / "rounds").glob("*.json")))
    return [episode for episode in episodes if episode.ending != CRASHED]


def library_of(folder: Path, objects: Path | None) -> ObjectLibrary:
    """The objects that it was played with. Raises `InputError` where they came from a folder and none is
    given, or run.json is another command's."""
    sets = facts_of(folder).get("object_sets")
    if not sets:
        raise InputError(f"{folder}: no evaluation (run.json: names no object sets)")
    if "folder" in sets and objects is None:
        raise InputError(f"{folder} was made with a folder of objects: give it as --objects DIR")
    return ObjectLibrary.open(sets, objects)


def scene_of(lying: dict[str, Any]) -> Scene:
    """What lay on the table at a moment of a round (`Attempt.before`, `Episode.left`)."""
    return scene_from_json(json.dumps({"format": "neugrasp-world", "version": 1, **lying}))
