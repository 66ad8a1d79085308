"""In which order grasps are tried, and where no more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from neugrasp.grasp import Grasp, Grasps
from neugrasp.robot.errors import Unreachable
from neugrasp.robot.interface import Manipulator
from neugrasp.robot.ranking import SAME_PLACE, failures_near, first_possible
from toy_boxes import detection

UP = np.array([0.0, 0.0, 1.0])


class Willing:
    """Can carry out everything."""

    def prepare(self, grasp: Grasp, _: object) -> Any:
        return grasp


def at(*position: float, score: float = 1.0) -> Grasp:
    pose = np.eye(4)
    pose[:3, 3] = position
    return Grasp(pose, 0.04, score)


def test_a_failure_counts_beside_it_at_any_height():
    grasps = Grasps.of(
        [at(0.1, 0.1, 0.1), at(0.1, 0.1 + 0.9 * SAME_PLACE, 0.2), at(0.1 + SAME_PLACE, 0.11, 0.1)]
    )
    failed = np.array([[0.1, 0.1, 0.05], [0.1, 0.1, 0.15]])
    assert failures_near(grasps, failed, UP).tolist() == [2, 2, 0]


def test_where_the_table_is_tilted_up_is_its_normal():
    up = np.array([0.0, 0.6, 0.8])
    above = Grasps.of([at(*(0.3 * up)), at(0, 0, 0.3)])
    assert failures_near(above, np.zeros((1, 3)), up).tolist() == [1, 0]


@pytest.mark.parametrize("count", [0, 3])
def test_without_failures_or_grasps_there_is_nothing_to_count(count: int):
    grasps = Grasps.of([at(0.1 * i, 0, 0) for i in range(count)])
    assert failures_near(grasps, np.zeros((0, 3)), UP).tolist() == [0] * count
    assert failures_near(Grasps.of([]), np.zeros((count, 3)), UP).tolist() == []


@pytest.mark.parametrize(
    ("failures", "chosen", "given_up"),
    [([0, 0, 0], 0, 0), ([1, 0, 0], 1, 0), ([1, 1, 1], 0, 0), ([2, 1, 1], 1, 1), ([2, 2, 3], None, 3)],
)
def test_fewest_failures_first_and_none_where_two_were(
    failures: list[int], chosen: int | None, given_up: int
):
    seen = detection(at(0.1, 0, 0), at(0.2, 0, 0), at(0.3, 0, 0))
    found = first_possible(cast("Manipulator", Willing()), seen, lambda _: 0, np.array(failures))
    assert found.index == chosen
    assert found.counts == ({"failed there before": given_up} if given_up else {})
    assert found.is_given_up == (chosen is None)


@pytest.mark.parametrize(
    ("failures", "left"),
    [([0, 0, 0, 0], [0.95, 0.93]), ([1, 1, 0, 0], [0.8]), ([1, 1, 2, 0], [0.7]), ([2, 1, 2, 2], [0.93])],
)
def test_what_is_chosen_is_nearly_as_sure_as_the_best_that_is_left(failures: list[int], left: list[float]):
    grasps = [at(0.1 * i, 0, 0, score=score) for i, score in enumerate((0.95, 0.93, 0.8, 0.7))]
    seen = replace(detection(*grasps), margin=0.04)
    offered: list[Any] = []

    def choose(among: Sequence[Grasp]) -> int:
        offered.append([grasp.score for grasp in among])
        return 0

    first_possible(cast("Manipulator", Willing()), seen, choose, np.array(failures))
    assert offered == [left]


def test_where_the_surest_cannot_be_reached_the_next_are_measured_by_what_is_left():
    class Short(Willing):
        def prepare(self, grasp: Grasp, _: object) -> Any:
            if grasp.score > 0.9:
                raise Unreachable("too far")
            return grasp

    seen = replace(detection(at(0.1, 0, 0, score=0.95), at(0.2, 0, 0, score=0.8)), margin=0.04)
    found = first_possible(cast("Manipulator", Short()), seen, lambda _: 0)
    assert (found.index, found.counts) == (1, {"unreachable": 1})
