"""A server under load, on this machine alone: errors, memory, and how long answers take.

    python benchmarks/serve_load.py [--minutes 10] [--clients 3] [--json FILE]

Starts `neugrasp serve` on the loopback address. Each client keeps a cell of its own, a bundled scene, and
asks it again and again. Every answer is held against the first one of its cell: backgrounds of another
cell would be seen. Before and after, the same detector is timed in a process of its own, alone.
At most 15 minutes.
"""

from __future__ import annotations

import argparse
import json
import re
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from neugrasp.client import Client
from neugrasp.demo.bundled import demo_scenes
from neugrasp.viewer.door import free_port

LONGEST = 15.0
ALONE = """
import sys, time
import neugrasp as ng
detector, views = ng.load_detector("neugrasp"), ng.read_scene(sys.argv[1])
seconds = []
for _ in range(12):
    begun = time.perf_counter()
    detector.detect(views)
    seconds.append(time.perf_counter() - begun)
print(sorted(seconds[2:])[5])
"""
"""Prints the median of ten detections after two to warm up."""


@dataclass
class Asked:
    """What one client saw."""

    seconds: list[float] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    others: int = 0
    """Answers that differ from the first one."""


def main() -> None:
    """Prints the figures; ends with 1 where an answer was wrong or missing."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--clients", type=int, default=3)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    minutes = min(options.minutes, LONGEST)
    scenes = [scene.folder for scene in demo_scenes()]
    before = alone(scenes[0])
    port = free_port("127.0.0.1", None)
    command = [sys.executable, "-m", "neugrasp", "serve", "--port", str(port)]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as server:
        try:
            url = f"http://127.0.0.1:{port}"
            wait_for(f"{url}/readyz")
            figures = load(url, [scenes[i % len(scenes)] for i in range(options.clients)], 60 * minutes)
        finally:
            server.send_signal(signal.SIGTERM)
    figures |= {"minutes": minutes, "clients": options.clients, "alone_median_s": [before]}
    print(json.dumps(figures, indent=1), flush=True)
    figures["alone_median_s"] = [before, alone(scenes[0])]
    print(f"alone before and after: {figures['alone_median_s']}")
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    sys.exit(bool(figures["errors"] or figures["other_answers"] or server.returncode))


def alone(scene: Path) -> float:
    """Median seconds of a detection in a process of its own."""
    told = subprocess.run(
        [sys.executable, "-c", ALONE, str(scene)], check=True, capture_output=True, text=True
    )
    return round(float(told.stdout), 4)


def load(url: str, scenes: list[Path], seconds: float) -> dict[str, object]:
    """What the clients saw, and how much memory the server had from a tenth of the time on."""
    every = [Asked() for _ in scenes]
    begun, end = time.monotonic(), time.monotonic() + seconds
    threads = [
        threading.Thread(target=ask, args=(url, f"cell{i}", scene, end, asked))
        for i, (scene, asked) in enumerate(zip(scenes, every, strict=True))
    ]
    for thread in threads:
        thread.start()
    memory = []
    while time.monotonic() < end:
        time.sleep(min(2.0, seconds / 20))
        if time.monotonic() - begun > seconds / 10:
            memory.append(meter(url, "process_resident_memory_bytes") / 2**20)
    for thread in threads:
        thread.join()
    took = np.array([one for asked in every for one in asked.seconds])
    third = max(1, len(memory) // 3)
    return {
        "answers": len(took),
        "errors": [error for asked in every for error in asked.errors],
        "other_answers": sum(asked.others for asked in every),
        "p50_s": round(float(np.quantile(took, 0.5)), 4),
        "p99_s": round(float(np.quantile(took, 0.99)), 4),
        "answers_per_s": round(len(took) / seconds, 3),
        "rss_mib_first_third": round(float(np.mean(memory[:third])), 1),
        "rss_mib_last_third": round(float(np.mean(memory[-third:])), 1),
        "background_hits": meter(url, 'neugrasp_backgrounds{result="hit"}'),
        "background_misses": meter(url, 'neugrasp_backgrounds{result="miss"}'),
        "detector_mean_s": detector_mean(url),
        "queue_mean_s": stage_mean(url, "queue"),
    }


def ask(url: str, cell: str, scene: Path, end: float, asked: Asked) -> None:
    """Asks a cell until the end."""
    images = sorted((scene / "images").iterdir())
    first: list[dict[str, object]] = []
    with Client(url) as client:
        client.keep_cell(cell, scene)
        while time.monotonic() < end:
            begun = time.perf_counter()
            try:
                found = client.detect_at(cell, images).to_dict()["grasps"]
            except Exception as error:
                asked.errors.append(f"{type(error).__name__}: {error}")
                continue
            asked.seconds.append(time.perf_counter() - begun)
            first = first or found
            asked.others += found != first


def meters(url: str) -> str:
    """What Prometheus would read."""
    with urllib.request.urlopen(f"{url}/metrics", timeout=10) as answer:
        text: str = answer.read().decode()
    return text


def meter(url: str, name: str) -> float:
    """The value of one counter."""
    (line,) = (one for one in meters(url).splitlines() if one.startswith(name + " "))
    return float(line.split()[-1])


def stage_mean(url: str, stage: str) -> float:
    """Mean seconds of a stage."""
    label = f'{{stage="{stage}"}}'
    total, count = (meter(url, f"neugrasp_stage_seconds_{part}{label}") for part in ("sum", "count"))
    return round(total / count, 4)


def detector_mean(url: str) -> float:
    """Mean seconds of all stages of the detector itself."""
    stages = set(re.findall(r'stage_seconds_count\{stage="(\w+)"\}', meters(url)))
    return round(sum(stage_mean(url, stage) for stage in stages - {"decode", "examine", "queue"}), 4)


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
