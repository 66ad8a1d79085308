"""Two evaluations of the same rounds, paired: what is the difference, and could it be chance?"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Compare
from neugrasp.evaluation.episode import Episode
from neugrasp.evaluation.protocols import protocol_of
from neugrasp.evaluation.results_io import facts_of, played
from neugrasp.evaluation.scores import RESAMPLES, first_succeeded
from neugrasp.evaluation.tables import comparison_table
from neugrasp.run_folder import CONTENTS
from neugrasp.terminal import next_step

SAME = ("protocol", "scene", "seed", "objects_sha256", "gripper")
"""What both evaluations must agree in; materials, views and detectors may be what is compared."""
Counts = NDArray[np.float64]
"""(rounds, 2): the part and the whole that a round adds to a pooled rate."""


def run(config: Compare) -> str:
    """`neugrasp compare`: the table of the differences."""
    return f"{comparison_table(compare(config.a, config.b))}\n{next_step('failures', config.b)}"


def compare(a: Path, b: Path) -> dict[str, Any]:
    """SR, FSR and DR of both and B - A in percentage points, over the rounds that both played to an end.

    The interval is a bootstrap over rounds. p is that of a randomisation test: were A and B alike, their
    results of a round could be swapped. Raises `InputError` where the rounds are not the same.
    """
    facts = [facts_of(folder, needs=("protocol",)) for folder in (a, b)]
    for key in (*SAME, *CONTENTS):
        if key in CONTENTS and not all(key in some for some in facts):
            continue
        if facts[0].get(key) != facts[1].get(key):
            raise InputError(
                f"{a} and {b} cannot be compared: {key} is {facts[0].get(key)!r} and {facts[1].get(key)!r}"
            )
    rounds = [{episode.index: episode for episode in played(folder)} for folder in (a, b)]
    common = sorted(set(rounds[0]) & set(rounds[1]))
    if not common:
        raise InputError(f"{a} and {b} have no round in common that both played to an end")
    for index in common:
        if rounds[0][index].scene_sha256 != rounds[1][index].scene_sha256:
            raise InputError(f"{a} and {b} cannot be compared: round {index} began with another scene")
    first, second = ([episodes[index] for index in common] for episodes in rounds)
    silent = protocol_of(facts[0]["protocol"]).count_silent_rounds
    return {
        "rounds": len(common),
        "SR": _compared(_grasps(first), _grasps(second)),
        "FSR": _compared(_firsts(first), _firsts(second)),
        "DR": _compared(_objects(first, silent), _objects(second, silent)),
    }


def _grasps(episodes: list[Episode]) -> Counts:
    return np.array([(e.successes, len(e.attempts)) for e in episodes], dtype=np.float64)


def _firsts(episodes: list[Episode]) -> Counts:
    return np.array([(first_succeeded(e), 1) for e in episodes], dtype=np.float64)


def _objects(episodes: list[Episode], silent: bool) -> Counts:
    return np.array(
        [(e.successes, e.objects if silent or e.attempts else 0) for e in episodes], dtype=np.float64
    )


def _share(counts: Counts) -> Counts:
    """Pooled percentages of counts (..., rounds, 2); 0 where nothing was counted."""
    part, whole = counts.sum(axis=-2)[..., 0], counts.sum(axis=-2)[..., 1]
    share: Counts = 100 * part / np.maximum(whole, 1)
    return share


def _compared(a: Counts, b: Counts) -> dict[str, Any]:
    rng = np.random.default_rng(0)
    difference = float(_share(b) - _share(a))
    drawn = rng.integers(len(a), size=(RESAMPLES, len(a)))
    low, high = np.percentile(_share(b[drawn]) - _share(a[drawn]), [2.5, 97.5])
    swapped = (rng.random((RESAMPLES, len(a))) < 0.5)[..., None]
    chance = _share(np.where(swapped, a, b)) - _share(np.where(swapped, b, a))
    as_large = int(np.count_nonzero(np.abs(chance) >= abs(difference) - 1e-9))
    return {
        "a": round(float(_share(a)), 2),
        "b": round(float(_share(b)), 2),
        "difference": round(difference, 2),
        "ci": [round(float(low), 2), round(float(high), 2)],
        "p": round((as_large + 1) / (RESAMPLES + 1), 5),
    }
