"""The demo: every bundled scene predicted, a row of a table for each."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from neugrasp.demo import bundled
from neugrasp.demo.command import Demo
from neugrasp.detection.contract import Detection
from neugrasp.detection.explanation import explain
from neugrasp.detection.registry import load_detector
from neugrasp.progress import counted
from neugrasp.terminal import next_step

FOLDERS = """
Every folder holds overlay.png (the photos with the grasps, 1 the best), surface.png (the surface above the
true one), slice.png (a cut through the distance grid), grasps.json, surface.ply and tsdf.npz."""
ROW = "{:<24} {:>6} {:>6} {:>8} {:>8}  {}"


def run(config: Demo) -> Iterator[str]:
    """`neugrasp demo`: a line at a time."""
    began = time.monotonic()
    detector = load_detector(
        weights=config.weights, gripper=config.gripper, device=config.device, precision=config.precision
    )
    scenes = bundled.demo_scenes()
    yield ROW.format("scene", "grasps", "best", "width", "seconds", "pictures")
    for scene in counted(scenes, "scenes"):
        folder, start = config.out / scene.name, time.monotonic()
        detection = bundled.run_demo(scene, detector, folder)
        yield _row(scene.name, detection, time.monotonic() - start, folder)
    yield f"{len(scenes)} scenes in {time.monotonic() - began:.0f} s, their pictures included."
    yield FOLDERS
    yield next_step("view", config.out / scenes[0].name)
    yield next_step("doctor", "MY_SCENE", why="a capture of your own: docs/capture.md")


def _row(name: str, detection: Detection, waited: float, folder: Path) -> str:
    """A row of the table; the seconds are those that a person waits."""
    grasps, seconds = detection.grasps, f"{waited:.1f}"
    if not grasps:
        return ROW.format(name, 0, "-", "-", seconds, folder) + "\n  " + explain(detection)
    best = f"{grasps[0].score:.2f}", f"{grasps[0].width * 1000:.0f} mm"
    return ROW.format(name, len(grasps), *best, seconds, folder)
