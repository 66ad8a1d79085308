"""Ending a run where scenes kept aside are no longer told better."""

from __future__ import annotations

import json
from pathlib import Path

from neugrasp.errors import InputError

SCORE = "grasp_loss"
"""The score of a validation that counts; the lower, the better."""


class EarlyStop:
    """The grasp losses of a run's validations. The log remembers them, so that a resumed run does."""

    def __init__(self, log: Path, patience: int):
        """`log` is a run's log.jsonl as it stands; with a `patience` of 0 nothing ever ends."""
        self.patience = patience
        self.losses = _validated(log) if patience else []

    def add(self, scores: dict[str, float]) -> bool:
        """Counts a validation; whether its network is the one to keep.

        Raises `InputError` where the score is not among them.
        """
        if not self.patience:
            return True
        if SCORE not in scores:
            raise InputError(
                f"a recipe with patience needs the score {SCORE!r}, which this network's judge lacks"
            )
        self.losses.append(scores[SCORE])
        return self.losses[-1] <= min(self.losses)

    @property
    def is_over(self) -> bool:
        """Whether the last `patience` validations were none of them the best."""
        if not self.patience or not self.losses:
            return False
        return len(self.losses) - 1 - self.losses.index(min(self.losses)) >= self.patience


def _validated(log: Path) -> list[float]:
    if not log.is_file():
        return []
    lines = map(json.loads, log.read_text(encoding="utf-8").splitlines())
    return [line["validation"][SCORE] for line in lines if SCORE in line.get("validation", {})]
