"""Rounds -> SR, FSR, DR and L1, each with its interval and its count (docs/benchmark.md)."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from neugrasp.evaluation.episode import CRASHED, ENDINGS, GIVEN_UP, NOTHING_REACHABLE, Attempt, Episode
from neugrasp.evaluation.protocols import EvaluationRules
from neugrasp.metrics import wilson_interval
from neugrasp.robot.pick import DROPPED, REASONS, SUCCESS

RESAMPLES = 10_000
HEADLINE_MASK = "0.3"
"""Depth of the L1 mask that is printed as "the" L1."""
TIMES = ("seconds_per_round", "seconds_by_stage", "rounds_per_hour_and_worker")
"""The entries that a second run of the same command need not repeat."""


def scores(episodes: Sequence[Episode], protocol: EvaluationRules) -> dict[str, Any]:
    """The entries of metrics.json that follow from the rounds; percentages and L1 are None where nothing was
    counted. Crashed rounds are listed and counted nowhere else."""
    played = [episode for episode in episodes if episode.ending != CRASHED]
    attempts = [attempt for episode in played for attempt in episode.attempts]
    cleared = counted_in_dr(played, protocol)
    successes = sum(attempt.success for attempt in attempts)
    firsts = sum(first_succeeded(episode) for episode in played)
    taken = np.array([episode.successes for episode in cleared])
    objects = np.array([episode.objects for episode in cleared])
    return {
        "rounds": len(played),
        "crashed": [episode.index for episode in episodes if episode.ending == CRASHED],
        "attempts": len(attempts),
        "successes": successes,
        "objects": int(objects.sum()),
        "lost_objects": sum(attempt.lost for attempt in attempts),
        **_rate("SR", successes, len(attempts)),
        **_rate("FSR", firsts, len(played)),
        "DR": _percent(int(taken.sum()), int(objects.sum())),
        "DR_ci": _bootstrap(taken, objects),
        "endings": _endings(played),
        "failures": _failures(attempts),
        **_skipped(played),
        "by_material": _by_material(played),
        **_l1(attempts),
        **_times(played),
    }


def counted_in_dr(played: Sequence[Episode], protocol: EvaluationRules) -> list[Episode]:
    """The rounds whose objects stand in the denominator of DR."""
    return [e for e in played if e.attempts or protocol.count_silent_rounds]


def first_succeeded(episode: Episode) -> bool:
    """Whether the first grasp of a round took an object off the table; False where there was none."""
    return bool(episode.attempts) and episode.attempts[0].success


def _percent(part: int, whole: int) -> float | None:
    return round(100 * part / whole, 2) if whole else None


def _rate(name: str, part: int, whole: int) -> dict[str, Any]:
    low, high = wilson_interval(part, whole)
    interval = [round(100 * low, 2), round(100 * high, 2)] if whole else None
    return {name: _percent(part, whole), f"{name}_ci": interval}


def _bootstrap(part: np.ndarray, whole: np.ndarray) -> list[float] | None:
    """The 95 % interval of the pooled percentage under resampling of rounds."""
    if not whole.sum():
        return None
    index = np.random.default_rng(0).integers(len(part), size=(RESAMPLES, len(part)))
    totals = whole[index].sum(axis=1)
    shares = 100 * part[index].sum(axis=1)[totals > 0] / totals[totals > 0]
    low, high = np.percentile(shares, [2.5, 97.5])
    return [round(float(low), 2), round(float(high), 2)]


def _endings(played: Sequence[Episode]) -> dict[str, int]:
    counts = Counter(episode.ending for episode in played)
    usual = {name: counts[name] for name in ENDINGS if name != CRASHED}
    return usual | _counted(counts, NOTHING_REACHABLE) | _counted(counts, GIVEN_UP)


def _failures(attempts: Sequence[Attempt]) -> dict[str, int]:
    counts = Counter(attempt.reason for attempt in attempts)
    return {reason: counts[reason] for reason in REASONS if reason != SUCCESS} | _counted(counts, DROPPED)


def _counted(counts: Counter[str], name: str) -> dict[str, int]:
    """What not every round can end with, where one did."""
    return {name: counts[name]} if counts[name] else {}


def _skipped(played: Sequence[Episode]) -> dict[str, Any]:
    """Grasps that were passed over, by reason; no entry where nothing was."""
    total: Counter[str] = Counter()
    for episode in played:
        total.update(episode.skipped)
    return {"skipped": dict(sorted(total.items()))} if total else {}


def _by_material(played: Sequence[Episode]) -> dict[str, dict[str, Any]]:
    """Objects of each material, and how many of them grasps took off the table; rounds that kept no record of
    what lay there are left out.

    A grasp's object is the one that is gone after it. Where others left the table with it, it is not known
    which was held, and none is counted.
    """
    objects: Counter[str] = Counter()
    taken: Counter[str] = Counter()
    for episode in played:
        states = [*(attempt.before for attempt in episode.attempts), episode.left]
        kinds = [Counter(one["kind"] for one in state["materials"]) for state in states if state]
        if len(kinds) < len(states):
            continue
        objects += kinds[0]
        for attempt, before, after in zip(episode.attempts, kinds, kinds[1:], strict=False):
            if attempt.success and not attempt.lost:
                taken += before - after
    return {
        kind: {"objects": count, "taken": taken[kind], "share": _percent(taken[kind], count)}
        for kind, count in sorted(objects.items())
    }


def _l1(attempts: Sequence[Attempt]) -> dict[str, Any]:
    """One value per executed grasp, then the plain mean; the constant predictors beside it."""
    judged = [attempt for attempt in attempts if HEADLINE_MASK in attempt.l1]
    if not judged:
        return {"L1": None, "L1_by_mask": None, "L1_constants": None}
    masks = dict.fromkeys(mask for attempt in judged for mask in attempt.l1)
    by_mask = {mask: _mean([a.l1[mask] for a in judged if mask in a.l1]) for mask in masks}
    constants = {
        value: {
            mask: _mean([a.l1_constants[value][mask] for a in judged if mask in a.l1_constants[value]])
            for mask in masks
        }
        for value in judged[0].l1_constants
    }
    return {"L1": by_mask[HEADLINE_MASK], "L1_by_mask": by_mask, "L1_constants": constants}


def _mean(values: Sequence[float]) -> float:
    return round(float(np.mean(values)), 5)


def _times(played: Sequence[Episode]) -> dict[str, Any]:
    stages: dict[str, float] = defaultdict(float)
    for episode in played:
        for stage, seconds in episode.timing_s.items():
            stages[stage] += seconds
    count = max(len(played), 1)
    per_round = sum(stages.values()) / count
    return {
        "seconds_per_round": round(per_round, 3),
        "seconds_by_stage": {stage: round(seconds / count, 3) for stage, seconds in stages.items()},
        "rounds_per_hour_and_worker": round(3600 / per_round, 1) if per_round else None,
    }
