"""The loop of the benchmark (docs/benchmark.md): look, detect, choose, execute, until nothing is left to do.

It drives the protocols of `robot.interface` and knows nothing of a simulation.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np

from neugrasp.detection.contract import Detection, Detector, Stopwatch
from neugrasp.evaluation.episode import (
    EMPTY,
    FAILED_TOO_OFTEN,
    GIVEN_UP,
    NOTHING_DETECTED,
    NOTHING_REACHABLE,
    UNFINISHED,
    Attempt,
    Episode,
)
from neugrasp.evaluation.protocols import ELSEWHERE, Choose, EvaluationRules
from neugrasp.geometry.pose import Array, to_quaternion
from neugrasp.robot.interface import Robot
from neugrasp.robot.pick import CARRIED_AWAY, Pick, pick
from neugrasp.robot.ranking import Chosen, failures_near, first_possible

Seen = TypeVar("Seen")


@dataclass(frozen=True)
class SurfaceError:
    """How good a detector's surface is."""

    l1: dict[str, float]
    constants: dict[str, dict[str, float]]


class GroundTruth(Protocol):
    """What is really there. Nothing of it reaches the detector."""

    def surface_error(self, detection: Detection) -> SurfaceError:
        """The detected surface against the true one."""
        ...

    def describe(self) -> dict[str, Any]:
        """What lies on the table, as plain data."""
        ...


@dataclass(frozen=True)
class EpisodeConfig:
    """What the rounds of an evaluation have in common."""

    rules: EvaluationRules
    choose: Choose
    rng: Callable[[int, int], np.random.Generator]
    """(round, attempt) -> the random numbers of a choice."""
    up: Array
    """Unit vector away from the table, world frame."""


def _nobody(_: Episode) -> None:
    """Listens to nothing."""


def _unheard(name: str, content: object) -> None:
    """Listens to nothing."""


LOOKING, DETECTING, PLANNING = "looking", "detecting", "planning"
"""What a round does; `DETECTING` comes with what was seen, `PLANNING` with the detection."""


@dataclass(frozen=True)
class Log:
    """What is known of a round that was begun before, and who is told of every attempt."""

    begun: Episode | None = None
    told: Callable[[Episode], None] = _nobody
    stage: Callable[[str, object], None] = _unheard
    """Told of what begins, and with what."""


@dataclass(frozen=True)
class _EpisodeRun:
    """One round under way."""

    config: EpisodeConfig
    index: int
    robot: Robot[Any]
    ground_truth: GroundTruth

    def choose(self, attempts: Sequence[Attempt], detection: Detection) -> Chosen:
        """The next of the detected grasps that can be carried out."""
        config, rng = self.config, self.config.rng(self.index, len(attempts))
        failures = None
        if config.rules.after_failure == ELSEWHERE:
            failed = np.array([attempt.position for attempt in attempts if not attempt.success])
            failures = failures_near(detection.grasps, failed, config.up)
        return first_possible(
            self.robot.manipulator, detection, lambda grasps: config.choose(grasps, rng, config.up), failures
        )

    def attempt(self, number: int, detection: Detection, chosen: Chosen, watch: Stopwatch) -> Attempt:
        """Carries out the grasp that was chosen."""
        config, robot = self.config, self.robot
        assert chosen.index is not None
        assert chosen.hand is not None
        grasp = detection.grasps[chosen.index]
        objects, before = robot.table.count(), self.ground_truth.describe()
        with watch.stage("judge"):
            error = self.ground_truth.surface_error(detection)
        with watch.stage("execute"):
            min_opening = config.rules.min_opening * robot.manipulator.max_opening
            result = pick(robot.manipulator, chosen.hand, grasp, min_opening, config.up)
        # A table that is only seen is counted when it is looked at.
        lost = max(0, objects - robot.table.count() - result.success)
        x, y, z = grasp.position.tolist()
        qx, qy, qz, qw = to_quaternion(grasp.pose).tolist()
        return Attempt(
            round=self.index,
            attempt=number,
            objects=objects,
            candidates=len(detection.grasps),
            score=float(grasp.score),
            width=float(grasp.width),
            position=(x, y, z),
            quaternion_xyzw=(qx, qy, qz, qw),
            success=result.success,
            reason=_reason(result, lost),
            touched=result.touched,
            lost=lost,
            opening=result.opening,
            l1=error.l1,
            l1_constants=error.constants,
            timing_s=watch.seconds | {f"detect: {name}": s for name, s in detection.timing_s.items()},
            before=before,
            skipped=chosen.counts,
        )


def declutter(
    config: EpisodeConfig,
    index: int,
    robot: Robot[Seen],
    detector: Detector[Seen],
    ground_truth: GroundTruth,
    log: Log | None = None,
) -> Episode:
    """Plays round `index` to its end, or the rest of a round that was begun."""
    run, log = _EpisodeRun(config, index, robot, ground_truth), log or Log()
    attempts = list(log.begun.attempts if log.begun else ())
    seconds: dict[str, float] = dict(log.begun.timing_s if log.begun else {})
    skipped = Counter(log.begun.skipped if log.begun else {})
    start = log.begun.objects if log.begun else robot.table.count()

    def so_far(ending: str) -> Episode:
        now = ground_truth.describe()
        return Episode(
            index, start, ending, tuple(attempts), timing_s=dict(seconds), left=now, skipped=dict(skipped)
        )

    while robot.table.count() > 0:
        if _failures_in_a_row(attempts) == config.rules.max_failures:
            return so_far(FAILED_TOO_OFTEN)
        watch = Stopwatch()
        log.stage(LOOKING, None)
        with watch.stage("look"):
            seen = robot.camera.capture()
        if robot.table.count() == 0:
            break
        log.stage(DETECTING, seen)
        with watch.stage("detect"):
            detection = detector.detect(seen)
        log.stage(PLANNING, detection)
        with watch.stage("plan"):
            chosen = run.choose(attempts, detection)
        skipped.update(chosen.counts)
        if chosen.index is not None:
            attempts.append(run.attempt(len(attempts), detection, chosen, watch))
        _add(seconds, watch.seconds)
        if chosen.index is None:
            return so_far(_ending(detection, chosen))
        log.told(so_far(UNFINISHED))
    return so_far(EMPTY)


def _ending(detection: Detection, chosen: Chosen) -> str:
    """Why none of the detected grasps is carried out."""
    if not detection.grasps:
        return NOTHING_DETECTED
    return GIVEN_UP if chosen.is_given_up else NOTHING_REACHABLE


def _failures_in_a_row(attempts: Sequence[Attempt]) -> int:
    """At the end."""
    return next((i for i, a in enumerate(reversed(attempts)) if a.success), len(attempts))


def _reason(result: Pick, lost: int) -> str:
    """A failure after which an object is missing took it away without having grasped it."""
    return CARRIED_AWAY if lost > 0 and not result.success else result.reason


def _add(total: dict[str, float], part: dict[str, float]) -> None:
    for stage, seconds in part.items():
        total[stage] = total.get(stage, 0.0) + seconds
