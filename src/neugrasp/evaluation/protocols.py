"""What published numbers differ in, one switch for each point (docs/benchmark.md)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from neugrasp.errors import InputError
from neugrasp.execution import MIN_OPENING
from neugrasp.geometry.pose import Array
from neugrasp.grasp import Grasp

ELSEWHERE: Final = "elsewhere"


@dataclass(frozen=True)
class EvaluationRules:
    """How a round is run and counted."""

    name: str
    table_contact: bool
    """Whether the hand stops where it touches the table, or feels objects only."""
    count_silent_rounds: bool
    """Whether DR counts the objects of rounds in which nothing was ever attempted. FSR always counts them."""
    strategy: str
    """Which of the detected grasps is carried out, where the user does not say: one of `STRATEGIES`."""
    object_friction: float | None = None
    """Lateral friction of all objects; None: each object's own, 1 in all the published sets."""
    max_failures: int = 2
    """Failures in a row that end a round."""
    after_failure: str = "anywhere"
    """Where the next grasp may be: "anywhere", or `ELSEWHERE`: first where none failed."""
    num_objects: int = 5

    @property
    def min_opening(self) -> float:
        """Share of the largest opening that must remain between the fingers for a success (Panda: 8 cm)."""
        return MIN_OPENING[self.name]


PROTOCOLS = {
    "paper": EvaluationRules(
        "paper",
        table_contact=True,
        count_silent_rounds=True,
        strategy="random",
    ),
    "vgn": EvaluationRules(
        "vgn",
        table_contact=True,
        count_silent_rounds=False,
        strategy="random",
    ),
    "graspnerf": EvaluationRules(
        "graspnerf",
        table_contact=False,
        count_silent_rounds=False,
        strategy="random",
    ),
}
"""NeuGrasp's, VGN's and GraspNeRF's."""


def protocol_of(name: str) -> EvaluationRules:
    """A named protocol. Raises `InputError` on an unknown name."""
    if name not in PROTOCOLS:
        raise InputError(f"unknown protocol {name!r}; choose one of {', '.join(PROTOCOLS)}")
    return PROTOCOLS[name]


Choose = Callable[[Sequence[Grasp], np.random.Generator, Array], int]
"""Index of the grasp to carry out among those detected (best first); the last argument points upwards."""


def _top(grasps: Sequence[Grasp], rng: np.random.Generator, up: Array) -> int:
    return int(np.argmax([grasp.score for grasp in grasps]))


def _random(grasps: Sequence[Grasp], rng: np.random.Generator, up: Array) -> int:
    return int(rng.integers(len(grasps)))


def _highest(grasps: Sequence[Grasp], rng: np.random.Generator, up: Array) -> int:
    return int(np.argmax([grasp.position @ up for grasp in grasps]))


STRATEGIES: dict[str, Choose] = {"top": _top, "random": _random, "highest": _highest}
"""The highest score; any with the same probability; the one farthest from the table."""


def strategy_of(name: str) -> Choose:
    """A named strategy. Raises `InputError` on an unknown name."""
    if name not in STRATEGIES:
        raise InputError(f"unknown strategy {name!r}; choose one of {', '.join(STRATEGIES)}")
    return STRATEGIES[name]
