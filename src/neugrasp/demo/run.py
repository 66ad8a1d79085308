"""The demo: every bundled scene predicted, a row of a table for each."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from neugrasp.demo import bundled
from neugrasp.demo.command import Demo
from neugrasp.detection.contract import Detection
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.detection.explanation import explain

ROW = "{:<24} {:>6} {:>6} {:>8} {:>8}  {}"


def run(config: Demo) -> Iterator[str]:
    """`neugrasp demo`: a line at a time."""
    detector = NeuGraspDetector.load(
        config.weights, config.gripper, config.device, precision=config.precision
    )
    yield ROW.format("scene", "grasps", "best", "width", "seconds", "pictures")
    for scene in bundled.demo_scenes():
        folder = config.out / scene.name
        yield _row(scene.name, bundled.run_demo(scene, detector, folder), folder)
    yield (
        "\nEvery folder holds overlay.png (the photos with the grasps, the best in green), surface.png\n"
        "(the surface above the true one), slice.png (a cut through the distance grid), grasps.json,\n"
        "surface.ply and tsdf.npz."
    )


def _row(name: str, detection: Detection, folder: Path) -> str:
    grasps, seconds = detection.grasps, f"{sum(detection.timing_s.values()):.1f}"
    if not grasps:
        return ROW.format(name, 0, "-", "-", seconds, folder) + "\n  " + explain(detection)
    best = f"{grasps[0].score:.2f}", f"{grasps[0].width * 1000:.0f} mm"
    return ROW.format(name, len(grasps), *best, seconds, folder)
