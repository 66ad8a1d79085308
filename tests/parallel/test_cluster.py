"""A Ray cluster of two nodes on this machine: the same results and the same bytes, whoever is killed."""

from __future__ import annotations

import importlib.util
import json
import os
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate, Table
from neugrasp.evaluation.paper_table import run
from neugrasp.evaluation.run import evaluate
from neugrasp.evaluation.scores import TIMES
from neugrasp.parallel.cluster import Cluster
from neugrasp.parallel.crew import spread
from neugrasp.simulation.command import Generate
from neugrasp.simulation.generate import generate
from squared import squares

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(900),
    pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="ray is not installed"),
    # Ray's own pipes and sockets, closed when it ends.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
]


@pytest.fixture
def nodes() -> Iterator[Any]:
    """A cluster of two nodes with two processors each."""
    utils: ModuleType = pytest.importorskip("ray.cluster_utils")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        # By itself a worker gives way to everything else that runs here.
        patch.setenv("RAY_worker_niceness", "0")
        helpers = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "simulation")]
        patch.setenv("PYTHONPATH", os.pathsep.join([*helpers, *sys.path]))
        cluster = utils.Cluster(
            initialize_head=True, head_node_args={"num_cpus": 2, "include_dashboard": False}
        )
        cluster.second = cluster.add_node(num_cpus=2)
        cluster.wait_for_nodes()
        yield cluster
        cluster.shutdown()


def test_tasks_are_done_on_both_nodes_and_what_dies_is_begun_anew(nodes: Any, tmp_path: Path):
    crew = Cluster(nodes.address)
    found = list(spread(crew, partial(squares, tmp_path, 0.3), [[i] for i in range(10)]))
    # 7 kills its first worker.
    assert sorted(square for square, _ in found) == [i * i for i in range(10)]
    assert len({process for _, process in found}) >= 4
    with pytest.raises(InputError, match=r"^13: is not squared here$"):
        list(spread(crew, partial(squares, tmp_path), [[13]]))


def test_a_node_that_dies_costs_its_tasks_only(nodes: Any, tmp_path: Path):
    (tmp_path / "died").touch()
    threading.Timer(3.0, lambda: nodes.remove_node(nodes.second, allow_graceful=False)).start()
    found = list(
        spread(Cluster(nodes.address), partial(squares, tmp_path, 0.5), [[i] for i in range(30) if i != 13])
    )
    assert sorted(square for square, _ in found) == [i * i for i in range(30) if i != 13]


def test_the_same_bytes_as_in_one_process(nodes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "simulation"))
    from noise_renderer import NoiseRenderer

    def made(name: str, **changes: Any) -> dict[str, bytes]:
        config = Generate(
            scene="packed",
            num=4,
            out=tmp_path / name,
            object_sets=("glassware",),
            grasp_points=2,
            scenes_per_cell=2,
            image_size=32,
            seed=4,
            **changes,
        )
        generate(config, NoiseRenderer)
        files = sorted((config.out / "scenes").rglob("*"))
        return {str(f.relative_to(config.out)): f.read_bytes() for f in files if f.is_file()}

    begun = time.monotonic()
    alone = made("one", workers=1)
    assert len(alone) > 20
    assert made("two", workers=2) == alone
    assert made("four", workers=4) == alone
    assert made("cluster", cluster=nodes.address) == alone
    assert time.monotonic() - begun < 800


def without_times(content: Any) -> Any:
    """What was found, but for how long it took, by which commit."""
    if isinstance(content, list):
        return [without_times(one) for one in content]
    if not isinstance(content, dict):
        return content
    dropped = ("timing_s", *TIMES, "commit")
    return {name: without_times(one) for name, one in content.items() if name not in dropped}


def test_the_same_rounds_as_in_one_process(nodes: Any, tmp_path: Path):
    def played(name: str, **changes: Any) -> list[Any]:
        config = Evaluate(out=tmp_path / name, detector="oracle", scene="single", rounds=4, seed=5, **changes)
        evaluate(config)
        files = [*sorted((config.out / "rounds").iterdir()), config.out / "metrics.json"]
        return [without_times(json.loads(file.read_text())) for file in files]

    alone = played("one", workers=1)
    assert len(alone) == 5
    assert sum(len(one["attempts"]) for one in alone[:4]) >= 4
    assert played("two", workers=2) == alone
    assert played("four", workers=4) == alone
    assert played("cluster", cluster=nodes.address) == alone


def test_the_same_table_as_in_one_process(nodes: Any, tmp_path: Path):
    def played(name: str, **changes: Any) -> Any:
        asked = {"rounds": 2, "detectors": ("antipodal",), "strategies": ("top",)}
        run(Table("single", out=tmp_path / name, **asked, **changes))
        return without_times(json.loads((tmp_path / name / "single.json").read_text()))

    alone = played("one", workers=1)
    assert [row["rounds"] for row in alone["rows"]] == [2, 2]
    assert played("cluster", cluster=nodes.address) == alone


@pytest.mark.parametrize("address", ["here", "localhost:", "127.0.0.1:99999"])
def test_an_address_that_is_none_is_named(tmp_path: Path, address: str):
    with pytest.raises(InputError, match=f"--cluster {address}: "):
        list(spread(Cluster(address), partial(squares, tmp_path), [[1]]))


def test_a_cluster_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(InputError, match=r"--cluster 127\.0\.0\.1:9: no Ray cluster answers there"):
        list(spread(Cluster("127.0.0.1:9"), partial(squares, tmp_path), [[1]]))
