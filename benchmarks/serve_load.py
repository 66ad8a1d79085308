"""A server asked by three robots, on this machine alone: errors, memory, and how long answers take.

    python benchmarks/serve_load.py [--minutes 10] [--clients 3] [--pick-seconds 3 6] [--json FILE]

Starts `neugrasp serve` on the loopback address. Each client keeps a cell of its own, a bundled scene, and
asks, then picks for a while, drawn from `--pick-seconds` and `--seed`; `--pick-seconds 0` asks again at once,
so that clients wait for one another. Every answer is held against the first one of its cell: backgrounds of
another cell would be seen. Before and after, the same detector is timed in a process of its own, on the same
scenes, with the same threads.

What is compared: a client's seconds go from PNG files to a `Detection` in its memory, with the grid; those of
the detector's own process from decoded photos in memory to the same. In both, backgrounds are known before.

Ends by itself, after `--minutes`, at most 15, and some 2 more; prints PASS or FAIL for each aim.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.client import Client, ServerError
from neugrasp.demo.bundled import demo_scenes
from neugrasp.viewer.door import free_port

LONGEST = 15.0
SLOWER, GROWN = 0.15, 0.02
"""Aims: p50 over the in-process median, and the change of memory, of 1."""
STEADY = 0.1
"""By how much the in-process medians of before and after may differ on a machine that is quiet, of 1."""
PROBE_S = 2.0
"""Seconds between two looks at the memory."""
BURST = 24
"""Requests at once, three times as many as a server holds by default."""
ALONE = """
import sys, time
import neugrasp as ng
detector, seconds = ng.load_detector("neugrasp"), []
for views in map(ng.read_scene, sys.argv[1:]):
    for i in range(14):
        time.sleep(0.5)
        begun = time.perf_counter()
        detector.detect(views)
        if i > 1:
            seconds.append(time.perf_counter() - begun)
print(sorted(seconds)[len(seconds) // 2])
"""
"""Prints the median of twelve detections of each scene after two to warm up, each after a rest."""


@dataclass
class Asked:
    """What one client saw."""

    seconds: list[float] = field(default_factory=list)
    stages: list[dict[str, float]] = field(default_factory=list)
    """Of the server, for each answer; `detector` is the detector's own time."""
    errors: list[str] = field(default_factory=list)
    others: int = 0
    """Answers that differ from the first one."""


@dataclass(frozen=True)
class Robot:
    """One client: its cell, and how it asks."""

    url: str
    cell: str
    scene: Path
    pick_s: tuple[float, float]
    seed: int

    def ask(self, end: float, asked: Asked) -> None:
        """Asks until the end, and picks in between."""
        rng = np.random.default_rng(self.seed)
        images = sorted((self.scene / "images").iterdir())
        first: list[dict[str, Any]] = []
        with Client(self.url) as client:
            client.keep_cell(self.cell, self.scene)
            # Robots do not begin at the same moment.
            time.sleep(rng.uniform(0, self.pick_s[1]))
            while time.monotonic() < end:
                begun = time.perf_counter()
                try:
                    answer = client.ask_at(self.cell, images)
                except Exception as error:
                    asked.errors.append(f"{type(error).__name__}: {error}")
                    continue
                asked.seconds.append(time.perf_counter() - begun)
                detector = sum(answer.detection.timing_s.values())
                asked.stages.append({**answer.seconds, "detector": detector})
                found = answer.detection.to_dict()["grasps"]
                first = first or found
                asked.others += found != first
                time.sleep(max(0.0, min(rng.uniform(*self.pick_s), end - time.monotonic())))


def main() -> None:
    """Prints the figures; ends with 1 where an aim is missed."""
    options = parsed()
    low, high = options.pick_seconds[0], options.pick_seconds[-1]
    minutes = min(options.minutes, LONGEST)
    bundled = [scene.folder for scene in demo_scenes()]
    scenes = [bundled[i % len(bundled)] for i in range(options.clients)]
    print(f"load before: {os.getloadavg()[0]:.1f}", flush=True)
    before = alone(scenes)
    port = free_port("127.0.0.1", None)
    url = f"http://127.0.0.1:{port}"
    command = [sys.executable, "-m", "neugrasp", "serve", "--port", str(port)]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as server:
        try:
            wait_for(f"{url}/readyz")
            robots = [
                Robot(url, f"cell{i}", scene, (low, high), options.seed + i) for i, scene in enumerate(scenes)
            ]
            figures = load(robots, 60 * minutes)
            figures |= overload(robots[0])
        finally:
            server.send_signal(signal.SIGTERM)
    figures |= {"minutes": minutes, "clients": options.clients, "pick_s": [low, high]}
    figures |= {"alone_median_s": [before, alone(scenes)], "server_ended_with": server.returncode}
    figures["p50_over_alone"] = round(figures["p50_s"] / float(np.mean(figures["alone_median_s"])), 3)
    print(json.dumps(figures, indent=1))
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    sys.exit(not judged(figures))


def parsed() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--clients", type=int, default=3)
    parser.add_argument("--pick-seconds", type=float, nargs="+", default=[3.0, 6.0], help="from, to; 0: none")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def judged(figures: dict[str, Any]) -> bool:
    """Whether all aims are reached; prints each."""
    grown, over = figures["rss_change_percent"], figures["p50_over_alone"]
    first, second = figures["alone_median_s"]
    failed = len(figures["errors"]) + figures["other_answers"]
    burst = figures["burst"]
    answered, refused = burst["answered"], burst["refused"]
    aims = {
        f"{figures['answers']} answers, {failed} errors or other answers": figures["answers"] and not failed,
        f"memory changed by {grown:+.1f} % at most after the first minute": abs(grown) <= 100 * GROWN,
        f"p50 is {over:.2f} times the in-process median": over <= 1 + SLOWER,
        f"of {BURST} requests at once {answered} were answered and {refused} refused with 429": (
            refused > 0 and answered + refused == BURST
        ),
        "the server drained and ended with 0": figures["server_ended_with"] == 0,
    }
    for aim, is_reached in aims.items():
        print(f"{'PASS' if is_reached else 'FAIL'}  {aim}")
    print(
        f"p99 {figures['p99_s']:.3f} s; waiting for others was {figures['queue_percent']:.1f} % of all time"
    )
    if abs(first / second - 1) > STEADY:
        print(f"the machine was not quiet: in-process {first:.3f} s before, {second:.3f} s after")
    return all(aims.values())


def alone(scenes: Sequence[Path]) -> float:
    """Median seconds of a detection in a process of its own."""
    command = [sys.executable, "-c", ALONE, *map(str, scenes)]
    told = subprocess.run(command, check=True, capture_output=True, text=True)
    return round(float(told.stdout), 4)


def load(robots: Sequence[Robot], seconds: float) -> dict[str, Any]:
    """What the clients saw, and how much memory the server had."""
    every = [Asked() for _ in robots]
    url, end = robots[0].url, time.monotonic() + seconds
    at_start = memory(url)
    threads = [
        threading.Thread(target=robot.ask, args=(end, asked))
        for robot, asked in zip(robots, every, strict=True)
    ]
    for thread in threads:
        thread.start()
    parts = watched(url, seconds)
    for thread in threads:
        thread.join()
    took = np.array([one for asked in every for one in asked.seconds])
    stages = [one for asked in every for one in asked.stages]
    known = {name: float(np.mean([one[name] for one in stages])) for name in stages[0]}
    known["answer"] = stage_mean(url, "answer")
    known["rest"] = float(took.mean()) - sum(known.values()) + known["examine"]
    p50, p95, p99 = (round(float(np.quantile(took, share)), 4) for share in (0.5, 0.95, 0.99))
    return {
        "answers": len(took),
        "errors": [error for asked in every for error in asked.errors],
        "other_answers": sum(asked.others for asked in every),
        "p50_s": p50,
        "p95_s": p95,
        "p99_s": p99,
        "mean_s": {"whole": round(float(took.mean()), 4), **{k: round(v, 4) for k, v in known.items()}},
        "queue_percent": round(100 * known["queue"] / float(took.mean()), 2),
        "rss_mib": {"start": at_start, "minutes": parts, "end": memory(url)},
        # The first part is for warming up.
        "rss_change_percent": round(100 * max((part / parts[1] - 1 for part in parts[1:]), key=abs), 2),
        "background_hits": meter(url, 'neugrasp_backgrounds{result="hit"}'),
        "background_misses": meter(url, 'neugrasp_backgrounds{result="miss"}'),
    }


def watched(url: str, seconds: float) -> list[float]:
    """MiB, the median of each minute, or of each tenth of a shorter time."""
    length = min(60.0, seconds / 10)
    parts: list[float] = []
    begun = time.monotonic()
    while len(parts) < round(seconds / length):
        seen = []
        while time.monotonic() < begun + (len(parts) + 1) * length:
            seen.append(memory(url))
            time.sleep(min(PROBE_S, length / 5))
        parts.append(round(float(np.median(seen)), 1))
    return parts


def overload(robot: Robot) -> dict[str, Any]:
    """What becomes of too many requests at once."""

    def once(_: int) -> str:
        try:
            with Client(robot.url, tries=1) as client:
                client.detect_at(robot.cell, sorted((robot.scene / "images").iterdir()))
        except ServerError as error:
            return "refused" if "holds as many requests as it may" in str(error) else str(error)
        return "answered"

    with ThreadPoolExecutor(BURST) as pool:
        said = list(pool.map(once, range(BURST)))
    others = sorted(set(said) - {"answered", "refused"})
    return {"burst": {"answered": said.count("answered"), "refused": said.count("refused"), "else": others}}


def meter(url: str, name: str) -> float:
    """One value of what Prometheus would read."""
    with urllib.request.urlopen(f"{url}/metrics", timeout=60) as answer:
        text: str = answer.read().decode()
    found = re.search(rf"^{re.escape(name)} (\S+)$", text, re.MULTILINE)
    assert found is not None, name
    return float(found[1])


def memory(url: str) -> float:
    """MiB that the server holds."""
    return round(meter(url, "process_resident_memory_bytes") / 2**20, 1)


def stage_mean(url: str, stage: str) -> float:
    """Mean seconds of a stage."""
    label = f'{{stage="{stage}"}}'
    total, count = (meter(url, f"neugrasp_stage_seconds_{part}{label}") for part in ("sum", "count"))
    return total / count


def wait_for(url: str) -> None:
    """Returns when the server is ready."""
    for _ in range(600):
        try:
            urllib.request.urlopen(url, timeout=5).close()
            return
        except OSError:
            time.sleep(0.2)
    raise SystemExit(f"{url}: no answer within two minutes")


if __name__ == "__main__":
    main()
