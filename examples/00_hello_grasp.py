"""Photos in, grasps out: the smallest program.

    python examples/00_hello_grasp.py

A scene that comes with the package is read, its surface and its grasps are predicted, and the best grasps are
printed: the place of the point between the finger pads in metres, the direction in which the hand approaches,
and how far apart the pads are when they touch. All of it is in the world in which the cameras were given.
outputs/hello/overlay.png shows the grasps in the photos, the best in green.

    python examples/00_hello_grasp.py --scene my_scene --gripper robotiq_2f85
"""

from __future__ import annotations

from pathlib import Path

import tyro

from neugrasp.data.scene_folder import read_scene
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.demo.bundled import demo_scenes
from neugrasp.detection.registry import load_detector


def main(
    scene: Path | None = None,
    weights: str = "neugrasp",
    gripper: str = "panda",
    out: Path = Path("outputs/hello"),
) -> None:
    """Predicts one scene; without --scene, the first of the bundled ones."""
    views = read_scene(scene or demo_scenes()[0].folder)
    detector = load_detector(weights=weights, gripper=gripper)
    detection = detector.detect(views)

    print(f"{len(detection.grasps)} grasps in {sum(detection.timing_s.values()):.1f} s")
    for grasp in detection.grasps[:5]:
        x, y, z = grasp.position
        print(
            f"score {grasp.score:.2f}  at {x:.3f} {y:.3f} {z:.3f} m  "
            f"approach {grasp.approach.round(2)}  width {grasp.width * 1000:.0f} mm"
        )
    if not detection.grasps:
        print(f"best score {detection.best_rejected:.2f}; rejected: {detection.rejected}")

    with whole_or_nothing(out) as part:
        detection.write(part, views)
    print(out / "overlay.png")


if __name__ == "__main__":
    tyro.cli(main)
