"""How long an evaluator takes to judge a thousand candidates, and the whole search, on a bundled scene.

python benchmarks/evaluator_speed.py [--evaluator neugrasp] [--threads 2] [--times 20]
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
import torch

from neugrasp.data.npz import npz_arrays
from neugrasp.demo.bundled import demo_scenes
from neugrasp.detection.judge import Judge
from neugrasp.geometry.pose import Array
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.grasp_evaluator import FineGrid, boxes, numbers


def median_ms(work: Callable[[], object], times: int) -> float:
    work()
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return 1000 * statistics.median(seconds)


@torch.no_grad()
def answers(judge: Judge, box: torch.Tensor, of_up: torch.Tensor) -> torch.Tensor:
    return torch.sigmoid(judge.network(box, of_up, judge.hand))


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--evaluator", default="neugrasp")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--times", type=int, default=20)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    workspace = Workspace()
    judge = Judge.load(options.evaluator, "panda", workspace)
    truth = (demo_scenes()[0].folder / "truth.npz").read_bytes()
    grid = npz_arrays(truth, {"tsdf": "f"}, "truth.npz")["tsdf"].astype(np.float32)
    drawn: Array = judge.candidates.draw(grid, workspace, rng(), 1000)
    poses = np.resize(drawn, (1000, 4, 4))
    told = torch.from_numpy(poses).float()
    fine = FineGrid.of(torch.from_numpy(grid), workspace)
    box, of_up = boxes(fine, told), numbers(told, workspace)
    rows = {
        "finer grid": lambda: FineGrid.of(torch.from_numpy(grid), workspace),
        "1,000 boxes": lambda: boxes(fine, told),
        "1,000 answers": lambda: answers(judge, box, of_up),
        "1,000 candidates drawn": lambda: judge.candidates.draw(grid, workspace, rng(), 1000),
        "the whole search": lambda: judge.find(grid, workspace),
    }
    for name, work in rows.items():
        sys.stdout.write(f"{name:<24} {median_ms(work, options.times):7.1f} ms\n")


if __name__ == "__main__":
    main()
