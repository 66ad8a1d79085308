"""Tasks to results, whoever works, and whoever dies."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from neugrasp.errors import InputError, NeuGraspError
from neugrasp.parallel.choice import crew_for
from neugrasp.parallel.cluster import Cluster
from neugrasp.parallel.crew import Crew, spread
from neugrasp.parallel.local import Here, Processes
from squared import squares

CREWS = [Here(), Processes(1), Processes(2), Processes(4)]


def done(crew: Crew, folder: Path, groups: list[list[int]], seconds: float = 0.0) -> list[tuple[int, int]]:
    return list(spread(crew, partial(squares, folder, seconds), groups))


@pytest.mark.slow
@pytest.mark.parametrize("crew", CREWS, ids=str)
def test_each_task_is_done_once_and_everything_is_put_away(crew: Crew, tmp_path: Path):
    found = done(crew, tmp_path, [[0, 1, 2], [], [3], [4, 5]])
    assert sorted(square for square, _ in found) == [0, 1, 4, 9, 16, 25]
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_opened_for_nothing(tmp_path: Path):
    assert done(Processes(2), tmp_path, [[], []]) == []
    assert done(Here(), tmp_path, []) == []


@pytest.mark.slow
def test_a_group_stays_with_one_worker_and_two_work_at_once(tmp_path: Path):
    found = done(Processes(2), tmp_path, [[1, 2, 3], [11, 12, 14]], seconds=0.3)
    by_group = [{process for square, process in found if (square > 100) == is_second} for is_second in (0, 1)]
    assert [len(processes) for processes in by_group] == [1, 1]
    assert by_group[0] != by_group[1]


@pytest.mark.slow
@pytest.mark.parametrize("crew", CREWS[1:], ids=str)
def test_a_worker_that_dies_costs_its_task_which_is_done_by_another(crew: Crew, tmp_path: Path, caplog):
    found = done(crew, tmp_path, [[6, 7, 8], [9]])
    assert sorted(square for square, _ in found) == [36, 49, 64, 81]
    assert "what it was doing is begun anew" in caplog.text


@pytest.mark.slow
def test_a_task_that_kills_all_its_workers_is_given_up(tmp_path: Path):
    with pytest.raises(NeuGraspError, match=r"a worker was killed \(out of memory\?\)"):
        done(Processes(2), tmp_path, [[66], [1, 2]])


@pytest.mark.parametrize("crew", CREWS, ids=str)
def test_what_a_task_refuses_comes_back_as_it_was_said(crew: Crew, tmp_path: Path):
    with pytest.raises(InputError, match=r"^13: is not squared here$"):
        done(crew, tmp_path, [[13]])
    assert list(tmp_path.iterdir()) == []


def test_by_default_a_process_for_each_core_and_no_more_than_tasks():
    assert crew_for(1, 5)[0] == Here()
    assert crew_for(3, 2)[0] == Processes(2)
    assert crew_for(None, 1)[0] == Here()
    assert crew_for(8, 3, "auto") == (Cluster("auto", 3), 1)
