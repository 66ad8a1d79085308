"""From arrays in memory to a scene on disk, and from there to grasps.

    python examples/01_your_own_photos.py

What you need of each view: a photo of the objects, a photo of the empty table from the same place, the 3x3
intrinsics in pixels, and the pose of the camera as a 4x4 matrix `world_from_camera` (OpenCV: x right, y down,
z forward; metres). Your world is whatever your robot calls its base. One more matrix says where the workspace
lies in it: a cube of 30 cm whose floor is 5 cm under the table's surface, so that a table at height h has its
workspace's corner at h - 0.05.

`capture` stands for your camera driver; here it takes a bundled scene apart into plain arrays and puts it at
another place of the world, as if a robot's base stood 40 cm away from the table. The grasps come back there.
A scene on disk can be kept, sent to somebody, and given to `neugrasp predict`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tyro

from neugrasp.data.scene_folder import read_scene, write_scene
from neugrasp.demo.bundled import demo_scenes
from neugrasp.detection.registry import load_detector
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import rigid, rotation_about
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import View, Views

WORLD_FROM_WORKSPACE = rigid(rotation_about((0, 0, 1), np.pi / 2), (0.55, -0.15, 0.02))
"""The cube in the robot's base: its corner, and a quarter turn about the vertical."""


def capture(source: Path) -> list[dict[str, np.ndarray]]:
    """One dictionary of plain arrays per view; replace it by your camera."""
    photos = []
    for view in read_scene(source).frames:
        photos.append(
            {
                "image": view.image,
                "background": view.background,
                "intrinsics": view.camera.intrinsics,
                "world_from_camera": WORLD_FROM_WORKSPACE @ view.camera.world_from_camera,
            }
        )
    return photos


def main(source: Path | None = None, weights: str = "neugrasp", out: Path = Path("outputs/my_scene")) -> None:
    """Writes a scene folder and predicts it."""
    views = []
    for photo in capture(source or demo_scenes()[0].folder):
        height, width = photo["image"].shape[:2]
        camera = Camera(photo["intrinsics"], photo["world_from_camera"], width, height)
        views.append(View(camera, photo["image"], photo["background"]))
    write_scene(out, Views(tuple(views), Workspace(world_from_workspace=WORLD_FROM_WORKSPACE)))

    # Reading checks everything: sizes, poses in millimetres, cameras that look away from the workspace.
    detection = load_detector(weights=weights).detect(read_scene(out))
    print(f"{len(detection.grasps)} grasps; the scene is in {out}")
    for grasp in detection.grasps[:3]:
        print(f"score {grasp.score:.2f}  TCP at {grasp.position.round(3)} in the robot's base")


if __name__ == "__main__":
    tyro.cli(main)
