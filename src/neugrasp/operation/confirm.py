"""`neugrasp run --confirm`: a person at a terminal is asked before anything moves."""

from __future__ import annotations

from typing import TextIO

from neugrasp.operation.person import Person
from neugrasp.operation.steps import described
from neugrasp.robot.attended import Step
from neugrasp.robot.errors import LeftOut
from neugrasp.robot.interface import Arm
from neugrasp.robot.motion import TO_GRASP, TO_PREGRASP, Motion

SKIPPABLE = (TO_PREGRASP, TO_GRASP)
"""Motions before the fingers close; after them the hand may hold something."""


class Confirming:
    """An attendant who waits for Enter."""

    def __init__(self, planner: Motion, asked: TextIO | None = None, told: TextIO | None = None):
        """`planner` is in the world of the cell file. Raises `InputError` where nobody sits at a terminal."""
        self._planner = planner
        self._person = Person(
            "--confirm asks a person before every motion: run it in a terminal", asked, told
        )

    def meet(self, arm: Arm) -> None:
        """Nothing moves while a person thinks; `Stopped` is enough."""

    def before(self, step: Step) -> None:
        """Returns on Enter. Raises `LeftOut` on s, where the grasp can still be left out, `Stopped` on q."""
        can_skip = step.grasp is not None or step.what in SKIPPABLE
        choices = "Enter: go" + (", s: leave this grasp out" if can_skip else "") + ", q: quit"
        self._person.told(f"next: {described(step, self._planner)}")
        while True:
            word = self._person.asked(f"  [{choices}]", ended="a person ended the run")
            if word in ("s", "skip") and can_skip:
                raise LeftOut("a person left it out")
            if not word:
                return
            self._person.told(f"  {word[:20]!r} is none of these")
