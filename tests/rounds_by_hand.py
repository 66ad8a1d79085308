"""Rounds written by hand."""

from __future__ import annotations

from typing import Any

from neugrasp.evaluation.episode import EMPTY, Attempt, Episode
from neugrasp.evaluation.protocols import protocol_of
from neugrasp.evaluation.scores import scores

FACTS = {
    "detector": "vgn",
    "scene": "packed",
    "materials": "diffuse",
    "strategy": "random",
    "protocol": "paper",
    "views": "released",
    "depth": "exact",
    "gripper": "panda",
    "seed": 0,
    "objects_sha256": "abc",
    "weights": "vgn_conv.pth",
}
"""What run.json says of an evaluation."""
REASON = {True: "success", False: "slipped on lifting"}


def attempt(index: int, number: int, success: bool, **changes: Any) -> Attempt:
    """A grasp of nothing in particular."""
    entries: dict[str, Any] = {
        "round": index,
        "attempt": number,
        "objects": 5 - number,
        "candidates": 3,
        "score": 0.95,
        "width": 0.04,
        "position": (0.1, 0.1, 0.1),
        "quaternion_xyzw": (1.0, 0.0, 0.0, 0.0),
        "success": success,
        "reason": REASON[success],
        "touched": False,
        "lost": 0,
        "opening": 0.03,
        "l1": {},
        "l1_constants": {},
        "timing_s": {"look": 1.0},
    }
    return Attempt(**(entries | changes))


def played(index: int, outcomes: str, objects: int = 5, ending: str = EMPTY, **changes: Any) -> Episode:
    """A round with one attempt per letter: "+" a success, "-" a failure."""
    attempts = tuple(attempt(index, i, letter == "+") for i, letter in enumerate(outcomes))
    return Episode(index, objects, ending, attempts, f"scene {index}", timing_s={"look": 2.0}, **changes)


def metrics(episodes: list[Episode], **changes: Any) -> dict[str, Any]:
    """The metrics.json of an evaluation that played these."""
    return {
        "format": "neugrasp-metrics",
        "version": 1,
        **FACTS,
        **scores(episodes, protocol_of("paper")),
        "command": "neugrasp evaluate ...",
        "commit": "abc1234",
        "machine": "here",
        **changes,
    }
