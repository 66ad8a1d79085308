"""How well many workers would share many scenes: a simulated schedule from measured times.

    python benchmarks/cluster_plan.py --data FOLDER [--scenes 10000] [--driver MS] [--start S]

FOLDER was made by `neugrasp generate`: a worker makes the scenes of a cell one after the other, so the
times between those are the times of a scene, and are drawn from, again and again. The schedule is that of
`parallel/crew.py`: each worker takes a group of scenes of one cell and asks the driver for each, which
needs `--driver` milliseconds for it, one at a time; a worker begins `--start` seconds late. Efficiency is
the sum of all scenes' times over workers times the whole time.
"""

from __future__ import annotations

import argparse
import heapq
from pathlib import Path

import numpy as np

WORKERS = (1, 2, 4, 8, 16, 32, 64, 128, 256, 1024, 4096)
GROUP = 8
"""Scenes of a cell."""


def times_of(data: Path) -> np.ndarray:
    """Seconds of each scene but the first of its cell, by when it was written."""
    done: dict[int, list[float]] = {}
    for folder in sorted((data / "scenes").iterdir()):
        done.setdefault(int(folder.name.rsplit("-", 1)[1]) // GROUP, []).append(folder.stat().st_mtime)
    return np.concatenate([np.diff(np.sort(times)) for times in done.values()])


def makespan(times: np.ndarray, workers: int, driver_s: float, start_s: float) -> float:
    """Seconds until all are done."""
    groups = [times[i : i + GROUP] for i in range(0, len(times), GROUP)][::-1]
    # When each worker is free, and what is left of its group.
    free = [(start_s, worker) for worker in range(min(workers, len(groups)))]
    left: dict[int, list[float]] = {}
    driver, end = 0.0, 0.0
    heapq.heapify(free)
    while free:
        now, worker = heapq.heappop(free)
        if not left.get(worker):
            if not groups:
                continue
            left[worker] = groups.pop().tolist()
        driver = max(driver, now) + driver_s
        done = driver + left[worker].pop(0)
        end = max(end, done)
        heapq.heappush(free, (done, worker))
    return end


def main() -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--scenes", type=int, default=10_000)
    parser.add_argument("--driver", type=float, default=2.0, help="milliseconds of the driver for a task")
    parser.add_argument("--start", type=float, default=20.0, help="seconds until a worker begins")
    options = parser.parse_args()
    measured = times_of(options.data)
    times = np.random.default_rng(0).choice(measured, options.scenes)
    quantiles = ", ".join(f"{x:.1f}" for x in np.quantile(measured, (0.05, 0.5, 0.95)))
    print(f"{len(measured)} measured scenes: mean {measured.mean():.2f} s; 5, 50, 95 %: {quantiles} s")
    print("| workers | hours | efficiency |\n|---|---|---|")
    for workers in WORKERS:
        whole = makespan(times, workers, options.driver / 1000, options.start)
        print(f"| {workers} | {whole / 3600:.2f} | {times.sum() / (workers * whole):.3f} |")


if __name__ == "__main__":
    main()
