"""Whether killed workers, nodes and drivers cost scenes: a data set made under kills, and one made in peace.

    python benchmarks/cluster_kills.py --out FOLDER [--kills 20] [--scenes 40] [--seed 0]

Starts a Ray cluster of two nodes with two workers each on this machine, and `neugrasp generate` on it,
without photos. At moments drawn from the seed a worker, a node or the driver, drawn too, is killed with
SIGKILL; a node is replaced by another one, a driver is started again. Scenes are added until all kills are
done. Then the same scenes are made by two processes that nobody kills, and every file is compared. Ends with
1 where one differs or is missing.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from ray.cluster_utils import Cluster

KINDS = ("worker", "worker", "node", "driver")
"""What is killed, as often as it stands here."""
MORE = 10
"""Scenes that are added where all are made and kills are left."""
LOOK_EVERY_S, PAUSE_S = 0.2, 2.0
"""Between two looks at the folder; and, at most, from a scene that was made to the next kill."""


def main() -> None:
    """Prints each kill, and the verdict."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    for name in ("killed", "peace"):
        shutil.rmtree(options.out / name, ignore_errors=True)
    # Ray's workers give way to all others (15) unless they are told not to.
    os.environ |= {"RAY_USAGE_STATS_ENABLED": "0", "RAY_worker_niceness": "0"}
    os.environ["PYTHONPATH"] = os.pathsep.join(part for part in sys.path if part)
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 2, "include_dashboard": False})
    try:
        hunt = Hunt(cluster, options.out / "killed", options.scenes, np.random.default_rng(options.seed))
        hunt.until(options.kills)
    finally:
        cluster.shutdown()
    begun = time.monotonic()
    subprocess.run(generating(options.out / "peace", hunt.scenes, "--workers", "2"), check=True)
    print(f"in peace: {time.monotonic() - begun:.0f} s with two processes")
    disturbed, peaceful = (contents(options.out / name) for name in ("killed", "peace"))
    wrong = [name for name in {**disturbed, **peaceful} if disturbed.get(name) != peaceful.get(name)]
    print(f"{sum(hunt.killed.values())} kills ({dict(hunt.killed)}), the driver started {hunt.starts} times")
    print(f"{hunt.scenes} scenes, {len(peaceful)} files, {len(wrong)} of them missing or different")
    print("FAIL" if wrong or not peaceful else "PASS")
    sys.exit(bool(wrong or not peaceful))


class Hunt:
    """A run that is disturbed."""

    def __init__(self, cluster: Cluster, out: Path, scenes: int, rng: np.random.Generator):
        self.cluster, self.out, self.scenes, self.rng = cluster, out, scenes, rng
        self.second = cluster.add_node(num_cpus=2)
        self.killed: Counter[str] = Counter()
        self.starts = 0
        self.driver = self.started()

    def started(self) -> subprocess.Popen[bytes]:
        """A driver that goes on where the last one stopped."""
        self.starts += 1
        command = generating(self.out, self.scenes, "--cluster", self.cluster.address)
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def until(self, kills: int) -> None:
        """Returns when so many were killed and all scenes are made."""
        begun, made_before = time.monotonic(), 0
        while True:
            time.sleep(LOOK_EVERY_S)
            count, ended = sum(self.killed.values()), self.driver.poll()
            if ended == 0 and count == kills:
                return
            if ended is not None:
                self.scenes += MORE * (ended == 0)
                self.driver = self.started()
            # A kill follows on a scene: else a slow machine would see nothing but workers that start.
            if count == kills or self.made() == made_before:
                continue
            time.sleep(self.rng.uniform(0, PAUSE_S))
            kind = str(self.rng.choice(KINDS))
            if self.driver.poll() is None and self.kill(kind):
                self.killed[kind] += 1
                made_before = self.made()
                print(f"{time.monotonic() - begun:6.1f} s: {kind}, {made_before} scenes made", flush=True)

    def made(self) -> int:
        """Scenes so far."""
        return len(list((self.out / "scenes").glob("[!.]*")))

    def kill(self, kind: str) -> bool:
        """Whether there was something to kill."""
        if kind == "driver":
            self.driver.kill()
            self.driver.wait()
        elif kind == "node":
            self.cluster.remove_node(self.second, allow_graceful=False)
            self.second = self.cluster.add_node(num_cpus=2)
        elif workers := own_workers():
            os.kill(int(self.rng.choice(workers)), signal.SIGKILL)
        else:
            return False
        return True


def own_workers() -> list[int]:
    """Processes of actors that this process started, by way of its nodes."""
    parents, actors = {}, []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            status, command = (folder / "stat").read_text(), (folder / "cmdline").read_bytes()
        except OSError:
            continue
        parents[int(folder.name)] = int(status.rpartition(")")[2].split()[1])
        if command.startswith(b"ray::Opened"):
            actors.append(int(folder.name))

    def is_own(process: int) -> bool:
        while process > 1 and process != os.getpid():
            process = parents.get(process, 0)
        return process == os.getpid()

    return sorted(filter(is_own, actors))


def generating(out: Path, scenes: int, *more: Any) -> list[str]:
    """The command."""
    kind = ("--scene", "packed", "--no-photos", "--object-sets", "glassware", "--grasp-points", "4")
    words = ("generate", "--out", out, "--num", scenes, "--scenes-per-cell", 2, *kind, *more)
    return [sys.executable, "-m", "neugrasp", *map(str, words)]


def contents(out: Path) -> dict[str, bytes]:
    """Of all scenes."""
    return {str(f.relative_to(out)): f.read_bytes() for f in (out / "scenes").rglob("*") if f.is_file()}


if __name__ == "__main__":
    main()
