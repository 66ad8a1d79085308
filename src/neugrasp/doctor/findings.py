"""What the doctor says: a level for each item, with the measured value and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum


class Level(IntEnum):
    """How bad it is."""

    GREEN = 0
    """As it should be."""
    GREY = 1
    """Not measured: the capture does not show what is needed."""
    YELLOW = 2
    """A prediction is possible and will be worse."""
    RED = 3
    """Grasps would fail."""

    @property
    def word(self) -> str:
        """Lower case, for people."""
        return self.name.lower()


@dataclass(frozen=True)
class Problem:
    """One thing that can be wrong with a capture, whatever the capture."""

    name: str
    """A few words; the heading in docs/troubleshooting.md."""
    meaning: str
    """What it does to a prediction, or how it comes about."""
    remedy: str
    """What to do, beginning with a verb."""
    is_universal: bool = False
    """Whether it is so with every capture: then its line says it, and the verdict does not."""


@dataclass(frozen=True)
class Finding:
    """The result of one check."""

    item: str
    """What was looked at."""
    level: Level
    measured: str
    """With units."""
    problem: Problem | None = None
    """None where there is nothing to do."""
    views: tuple[int, ...] = ()
    """The views that are meant; none for all of them."""

    def line(self) -> str:
        """One line for a terminal."""
        where = f"{views_text(self.views)}: " if self.views else ""
        text = f"{self.level.word:<7} {self.item:<22} {where}{self.measured}"
        return text if self.problem is None else f"{text}. {self.problem.remedy}"


def views_text(views: Sequence[int]) -> str:
    """ "view 2", or "views 0, 1"."""
    return ("view " if len(views) == 1 else "views ") + ", ".join(str(i) for i in views)


def named(bad: Sequence[int], count: int) -> tuple[int, ...]:
    """The views to name: none where all of several are meant."""
    return () if len(bad) == count > 1 else tuple(bad)


def green(item: str, measured: str) -> Finding:
    """Nothing to say against it."""
    return Finding(item, Level.GREEN, measured)


def not_measured(item: str, why: str, problem: Problem | None = None) -> Finding:
    """It could not be measured; `problem` where that leaves open whether grasps will hold."""
    return Finding(item, Level.GREY, why, problem)


def worst(findings: Sequence[Finding]) -> Level:
    """The level of the whole. What was not measured speaks neither for nor against it."""
    levels = [finding.level for finding in findings if finding.level != Level.GREY]
    return max(levels, default=Level.GREEN)


def verdict(findings: Sequence[Finding]) -> str:
    """The level of the whole, and what stayed open: "green, but poses unchecked: no texture on the table"."""
    open_ones = [(f.problem, f.measured) for f in findings if f.level == Level.GREY and f.problem]
    words = [
        f"{p.name[0].lower()}{p.name[1:]}: {measured}" for p, measured in open_ones if not p.is_universal
    ]
    level = worst(findings)
    return level.word + (", but " + "; ".join(words) if words and level != Level.RED else "")


@dataclass(frozen=True)
class Verdict:
    """What a command says, and the code with which it ends."""

    text: str
    exit_code: int

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class Limits:
    """From where on a measured value is yellow, and red."""

    yellow: float
    red: float

    def level(self, value: float) -> Level:
        """The level of a value that is better the smaller it is."""
        if value > self.red:
            return Level.RED
        return Level.YELLOW if value > self.yellow else Level.GREEN


def judged(
    item: str, values: Sequence[float], limits: Limits, unit: str, problem: Problem, digits: int = 2
) -> Finding:
    """A finding on one value per view, better the smaller: the worst decides, and all as bad are named."""
    levels = [limits.level(value) for value in values]
    level = max(levels)
    text = f"{max(values):.{digits}f} {unit}".strip()
    if level == Level.GREEN:
        return green(item, f"at most {text}" if len(values) > 1 else text)
    bad = [i for i, one in enumerate(levels) if one == level]
    return Finding(item, level, f"{text} ({limits.yellow:g} is fine)", problem, named(bad, len(values)))
