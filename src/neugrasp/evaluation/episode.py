"""What is kept of a round, and its JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from neugrasp.errors import InputError

EMPTY = "table empty"
NOTHING_DETECTED = "nothing detected"
FAILED_TOO_OFTEN = "failures in a row"
CRASHED = "crashed"
ENDINGS = (EMPTY, NOTHING_DETECTED, FAILED_TOO_OFTEN, CRASHED)

FORMAT, VERSION = "neugrasp-round", 1


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
    """Of the TCP, world frame, metres."""
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
    """Of the bodies as they lay at the beginning."""
    error: str = ""
    """Why it crashed."""
    timing_s: dict[str, float] = field(default_factory=dict)
    """Seconds by stage, attempts included."""
    left: dict[str, Any] | None = None
    """What lay on the table at the end, as plain data."""

    @property
    def successes(self) -> int:
        """Objects that were taken off the table."""
        return sum(attempt.success for attempt in self.attempts)


def write_episode(path: Path, episode: Episode) -> None:
    """Writes the file whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.tmp")
    data = {"format": FORMAT, "version": VERSION, **asdict(episode)}
    temporary.write_text(json.dumps(data) + "\n", encoding="utf-8")
    temporary.replace(path)


def read_episode(path: Path) -> Episode:
    """The inverse of `write_episode`. Raises `InputError` naming the file."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data.pop("format") != FORMAT or data.pop("version") != VERSION:
            raise InputError(f"{path}: not a {FORMAT} of version {VERSION}")
        attempts = tuple(_attempt(attempt) for attempt in data.pop("attempts"))
        return Episode(**data, attempts=attempts)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except (KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: damaged record of a round ({error!r}); delete it and run again") from error


def _attempt(data: dict[str, Any]) -> Attempt:
    data["position"], data["quaternion_xyzw"] = tuple(data["position"]), tuple(data["quaternion_xyzw"])
    return Attempt(**data)


def attempt_line(attempt: Attempt) -> str:
    """The attempt as one line of attempts.jsonl: everything but what lay on the table."""
    data = {f.name: getattr(attempt, f.name) for f in fields(attempt) if f.name != "before"}
    return json.dumps(data) + "\n"
