"""The folder that `neugrasp evaluate` writes, as later commands read it."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from neugrasp.data.fields import Fields
from neugrasp.data.strict_json import read_json
from neugrasp.data.world import Scene, scene_from_json
from neugrasp.errors import InputError
from neugrasp.evaluation.episode import CRASHED, Episode, read_episode
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.objects import KINDS, ObjectLibrary

FORMAT, VERSION = "neugrasp-metrics", 1
"""Format and version of metrics.json."""
WORDS = {"detector", "scene", "materials", "strategy", "protocol", "views", "gripper", "split"}
NEEDED = ("object_sets", "scene", "seed", "views", "gripper", "materials")
"""What the rounds of an evaluation are made again from."""


def facts_of(folder: Path, needs: Collection[str] = ()) -> dict[str, Any]:
    """What the rounds of an evaluation depend on, `needs` among it. Raises `InputError` where there is no
    evaluation."""
    path = folder / "run.json"
    if not path.is_file():
        raise InputError(f"{folder}: no evaluation (no run.json)")
    fields = Fields(str(path), read_json(path, "the description of an evaluation"))
    for key in needs:
        fields.get(key)
    for key in WORDS & fields.data.keys():
        fields.text(key, KINDS if key == "scene" else ())
    if "seed" in fields.data:
        fields.whole("seed", 0, 2**63)
    if "samples" in fields.data:
        fields.whole("samples", 1, 2**16)
    return fields.data


def workspace_of(facts: Mapping[str, Any]) -> Workspace:
    """The cube of an evaluation: its detector's, where that has one of its own. Raises `InputError`."""
    return Workspace.from_dict(facts.get("workspace", {}), "the evaluation's workspace")


def played(folder: Path) -> list[Episode]:
    """Its rounds in order, without those that crashed. Raises `InputError` where one is damaged."""
    episodes = map(_own, sorted((folder / "rounds").glob("[!.]*.json")))
    return [episode for episode in episodes if episode.ending != CRASHED]


def _own(path: Path) -> Episode:
    """The round that a file is named after: rounds are paired by their numbers."""
    episode = read_episode(path)
    if path.stem.isdecimal() and int(path.stem) != episode.index:
        raise InputError(f"{path}: is of round {episode.index}; delete it and run again")
    for number, attempt in enumerate(episode.attempts):
        if (attempt.round, attempt.attempt) != (episode.index, number):
            told = f"is attempt {attempt.attempt} of round {attempt.round}"
            raise InputError(f"{path}: attempts[{number}] {told}; delete the file and run again")
    return episode


def library_of(folder: Path, objects: Path | None) -> ObjectLibrary:
    """The objects that it was played with. Raises `InputError` where they came from a folder and none is
    given, or run.json is another command's."""
    sets = facts_of(folder).get("object_sets")
    if not isinstance(sets, list) or not sets or not all(isinstance(name, str) for name in sets):
        raise InputError(f"{folder}: no evaluation (run.json: names no object sets)")
    if "folder" in sets and objects is None:
        raise InputError(f"{folder} was made with a folder of objects: give it as --objects DIR")
    return ObjectLibrary.open(sets, objects)


def scene_of(lying: dict[str, Any]) -> Scene:
    """What lay on the table at a moment of a round (`Attempt.before`, `Episode.left`)."""
    content = json.dumps({"format": "neugrasp-world", "version": 1, **lying})
    return scene_from_json(content, "what a round says of its table")
