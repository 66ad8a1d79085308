"""What is kept of a round, and its JSON."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from neugrasp.data.fields import Fields
from neugrasp.data.strict_json import read_json
from neugrasp.errors import InputError
from neugrasp.output import write_text

EMPTY = "table empty"
NOTHING_DETECTED = "nothing detected"
FAILED_TOO_OFTEN = "failures in a row"
CRASHED = "crashed"
NOTHING_REACHABLE = "nothing reachable"
"""Where an arm carries out none of the detected grasps."""
GIVEN_UP = "only where grasps failed"
"""Where all detected grasps are at places that were given up (`robot.ranking`)."""
UNFINISHED = "unfinished"
"""The ending of a round that goes on where it is: `neugrasp run` writes it after every pick."""
ENDINGS = (EMPTY, NOTHING_DETECTED, FAILED_TOO_OFTEN, CRASHED)
"""The endings of every round; `NOTHING_REACHABLE` besides, where there is an arm, and `GIVEN_UP`."""

FORMAT, VERSION = "neugrasp-round", 1
MANY, FAR = 10**9, 1e9
"""Beyond what any count, and any number, of a round may be."""


@dataclass(frozen=True)
class Attempt:
    """One executed grasp."""

    round: int
    attempt: int
    """Counted from 0 within the round."""
    objects: int
    """In the workspace before it."""
    candidates: int
    """Grasps to choose from."""
    score: float
    width: float
    """Predicted, metres."""
    position: tuple[float, float, float]
    """Position of the TCP, world frame, metres."""
    quaternion_xyzw: tuple[float, float, float, float]
    success: bool
    reason: str
    """One of `robot.pick.REASONS`."""
    touched: bool
    """Whether a contact stopped the hand on its way."""
    lost: int
    """Objects that left the workspace without having been grasped."""
    opening: float
    """Between the pads at the end, metres."""
    l1: dict[str, float]
    """Error of the detector's surface by mask; empty where it was not judged."""
    l1_constants: dict[str, dict[str, float]]
    """The same of constant predictors, by their value."""
    timing_s: dict[str, float]
    """Seconds by stage."""
    before: dict[str, Any] | None = None
    """What lay on the table, as plain data."""
    skipped: dict[str, int] = field(default_factory=dict)
    """Grasps that were passed over before this one, by reason."""


@dataclass(frozen=True)
class Episode:
    """One round."""

    index: int
    objects: int
    """On the table at its beginning."""
    ending: str
    """One of `ENDINGS`."""
    attempts: tuple[Attempt, ...] = ()
    scene_sha256: str = ""
    """Hash of the bodies as they lay at the beginning."""
    error: str = ""
    """Why it crashed."""
    timing_s: dict[str, float] = field(default_factory=dict)
    """Seconds by stage, attempts included."""
    left: dict[str, Any] | None = None
    """What lay on the table at the end, as plain data."""
    skipped: dict[str, int] = field(default_factory=dict)
    """Grasps that were passed over in the whole round, by reason."""

    @property
    def successes(self) -> int:
        """Objects that were taken off the table."""
        return sum(attempt.success for attempt in self.attempts)


def write_episode(path: Path, episode: Episode) -> None:
    """Writes the file whole or not at all."""
    data = {"format": FORMAT, "version": VERSION, **_spare(asdict(episode))}
    data["attempts"] = [_spare(attempt) for attempt in data["attempts"]]
    write_text(path, json.dumps(data, allow_nan=False) + "\n")


def read_episode(path: Path) -> Episode:
    """The inverse of `write_episode`. Raises `InputError` naming the file."""
    if not path.is_file():
        raise InputError(f"{path}: cannot be read (no such file)")
    try:
        return _episode(Fields(str(path), read_json(path, "the record of a round")))
    except InputError as error:
        raise InputError(f"{error}; damaged record of a round: delete it and run again") from error


def _episode(fields: Fields) -> Episode:
    fields.expect(FORMAT, VERSION)
    fields.only(("format", "version", *(f.name for f in dataclasses.fields(Episode))))
    return Episode(
        fields.whole("index", 0, MANY),
        fields.whole("objects", 0, MANY),
        fields.text("ending", (*ENDINGS, NOTHING_REACHABLE, GIVEN_UP, UNFINISHED)),
        tuple(map(_attempt, fields.each("attempts"))),
        fields.text("scene_sha256"),
        fields.text("error"),
        fields.inside("timing_s").each_number(0, FAR),
        _lying(fields, "left"),
        _skipped(fields),
    )


def _attempt(fields: Fields) -> Attempt:
    fields.only(f.name for f in dataclasses.fields(Attempt))
    x, y, z = fields.numbers("position", 3, FAR, "[x, y, z] in metres").tolist()
    qx, qy, qz, qw = fields.unit("quaternion_xyzw", 4).tolist()
    constants = fields.inside("l1_constants")
    return Attempt(
        fields.whole("round", 0, MANY),
        fields.whole("attempt", 0, MANY),
        fields.whole("objects", 0, MANY),
        fields.whole("candidates", 0, MANY),
        fields.number("score", -FAR, FAR),
        fields.number("width", -FAR, FAR, "m"),
        (x, y, z),
        (qx, qy, qz, qw),
        fields.flag("success"),
        fields.text("reason"),
        fields.flag("touched"),
        fields.whole("lost", 0, MANY),
        fields.number("opening", -FAR, FAR, "m"),
        fields.inside("l1").each_number(0, FAR),
        {value: constants.inside(value).each_number(0, FAR) for value in constants.data},
        fields.inside("timing_s").each_number(0, FAR),
        _lying(fields, "before"),
        _skipped(fields),
    )


def _lying(fields: Fields, field: str) -> dict[str, Any] | None:
    """What lay on the table, or null."""
    return None if fields.get(field) is None else fields.inside(field).data


def _spare(data: dict[str, Any]) -> dict[str, Any]:
    """Without what was passed over, where nothing was: the record of a round is as it always was."""
    return {name: value for name, value in data.items() if name != "skipped" or value}


def _skipped(fields: Fields) -> dict[str, int]:
    if "skipped" not in fields.data:
        return {}
    inside = fields.inside("skipped")
    return {reason: inside.whole(reason, 0, MANY) for reason in inside.data}


def attempt_line(attempt: Attempt) -> str:
    """The attempt as one line of attempts.jsonl: everything but what lay on the table."""
    data = {f.name: getattr(attempt, f.name) for f in dataclasses.fields(attempt) if f.name != "before"}
    return json.dumps(_spare(data), allow_nan=False) + "\n"
