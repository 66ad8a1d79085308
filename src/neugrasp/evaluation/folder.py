"""The folder that `neugrasp evaluate` writes, as later commands read it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from neugrasp.errors import InputError
from neugrasp.evaluation.episode import CRASHED, Episode, read_episode
from neugrasp.simulation.objects import ObjectLibrary


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
    given."""
    sets = facts_of(folder)["object_sets"]
    if "folder" in sets and objects is None:
        raise InputError(f"{folder} was made with a folder of objects: give it as --objects DIR")
    return ObjectLibrary.open(sets, objects)
