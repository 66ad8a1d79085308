"""At which objects, made of what, the grasps of an evaluation failed, and why."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Failures
from neugrasp.evaluation.episode import Attempt
from neugrasp.evaluation.results_io import facts_of, library_of, played, scene_of, workspace_of
from neugrasp.progress import counted
from neugrasp.robot.pick import REASONS, SUCCESS
from neugrasp.simulation.physics import World
from neugrasp.terminal import next_step


@dataclass(frozen=True)
class Aimed:
    """A grasp, and the object that was nearest to its TCP."""

    name: str
    material: str
    reason: str
    """One of `robot.pick.REASONS`."""


def run(config: Failures) -> str:
    """`neugrasp failures`: the table."""
    objects = [] if config.objects is None else ["--objects", config.objects]
    table = failures_table(aimed_grasps(config.evaluation, config.objects))
    return f"{table}\n{next_step('inspect-episode', config.evaluation, 0, *objects)}"


def aimed_grasps(evaluation: Path, objects: Path | None = None) -> list[Aimed]:
    """Every executed grasp of an evaluation with its object, in order.

    Raises `InputError` where there is no evaluation, its objects are not given, or its rounds do not say what
    lay on the table.
    """
    workspace = workspace_of(facts_of(evaluation))
    with World(workspace, library_of(evaluation, objects)) as world:
        attempts = [attempt for episode in played(evaluation) for attempt in episode.attempts]
        if not attempts:
            raise InputError(
                f"{evaluation}: nothing was grasped in it yet; `neugrasp evaluate` goes on with it"
            )
        return [_aimed(world, attempt, evaluation) for attempt in counted(attempts, "attempts")]


def _aimed(world: World, attempt: Attempt, evaluation: Path) -> Aimed:
    if not attempt.before:
        raise InputError(
            f"{evaluation}: round {attempt.round} does not say what lay on the table; play it again with "
            "this version"
        )
    scene = scene_of(attempt.before)
    world.reset(scene)
    nearest = world.nearest(np.array(attempt.position))
    if nearest is None:
        raise InputError(f"{evaluation}: round {attempt.round} grasps where nothing lies")
    return Aimed(scene.bodies[nearest].name, scene.materials[nearest].kind, attempt.reason)


def failures_table(grasps: list[Aimed]) -> str:
    """Grasps by material, then by object, the one with most failures first; those without any in one line."""
    by_material = _counted((grasp.material, grasp.reason) for grasp in grasps)
    by_object = _counted((grasp.name, grasp.reason) for grasp in grasps)
    failing = {name: counts for name, counts in by_object.items() if counts.total() > counts[SUCCESS]}
    others: Counter[str] = sum((by_object[name] for name in by_object.keys() - failing), Counter())
    return "\n".join(
        [
            *_part("material", sorted(by_material.items())),
            "",
            *_part("object", sorted(failing.items(), key=_most_failures_first)),
            *([_line(f"{len(by_object) - len(failing)} others", others)] if others else []),
        ]
    )


def _counted(pairs: Iterable[tuple[str, str]]) -> dict[str, Counter[str]]:
    """Reasons by whatever they are paired with."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for name, reason in pairs:
        counts[name][reason] += 1
    return counts


def _most_failures_first(item: tuple[str, Counter[str]]) -> tuple[int, str]:
    name, counts = item
    return counts[SUCCESS] - counts.total(), name


def _part(head: str, rows: list[tuple[str, Counter[str]]]) -> Iterator[str]:
    reasons = [reason for reason in REASONS if reason != SUCCESS]
    yield "| " + " | ".join([head, "grasps", "held", "%", *reasons]) + " |"
    yield "|" + "---|" * (4 + len(reasons))
    for name, counts in rows:
        yield _line(name, counts)


def _line(name: str, counts: Counter[str]) -> str:
    reasons = [str(counts[reason]) for reason in REASONS if reason != SUCCESS]
    total, held = counts.total(), counts[SUCCESS]
    return "| " + " | ".join([name, str(total), str(held), f"{100 * held / total:.0f}", *reasons]) + " |"
