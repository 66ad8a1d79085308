"""A detector of your own: anything that turns `Views` into a `Detection`.

    python examples/07_your_own_detector.py --scene outputs/glass

This one has learned nothing. Where a photo looks like the photo of the empty table, there is nothing between
the camera and the table; what no view has emptied is matter. That is the visual hull, and it works on glass,
because glass changes the picture, too. From a narrow arc of views the hull is too high, and it has no
hollows: compare surface.png with the photos. One antipodal grasp is drawn on it at random.

Whatever has a method `detect(views) -> Detection` can be exported and drawn like the network's predictions.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import tyro
from scipy.ndimage import binary_closing, binary_fill_holes, binary_opening, distance_transform_edt

from neugrasp.baselines.antipodal import antipodal_grasp
from neugrasp.data.scene_folder import read_scene
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.demo import demo_scenes
from neugrasp.detection.detector import Detection, Detector
from neugrasp.export import write_picture, write_prediction
from neugrasp.gripper import Gripper
from neugrasp.pictures import surface_sheet
from neugrasp.views import Views

CHANGED = 20
"""Of 255: how much a pixel differs from the empty table where something stands in front of it."""


class VisualHull:
    """Carves away what the unchanged pixels have seen to be empty."""

    def __init__(self, gripper: Gripper, seed: int = 0):
        self.gripper, self.rng = gripper, np.random.default_rng(seed)

    def detect(self, views: Views) -> Detection:
        """One grasp, or none."""
        start = time.perf_counter()
        workspace = views.workspace
        points = workspace.voxel_centres()
        matter = points[..., 2] > workspace.table_height
        for view in views.views:
            difference = np.abs(view.image.astype(int) - view.background).max(axis=-1)
            changed = binary_fill_holes(binary_closing(difference > CHANGED, iterations=3))
            pixels, _ = view.camera.project(workspace.to_world(points))
            column, row = np.rint(pixels).astype(int).transpose(3, 0, 1, 2)
            height, width = changed.shape
            seen = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            matter &= seen & changed[row.clip(0, height - 1), column.clip(0, width - 1)]
        solid = binary_opening(matter) | (points[..., 2] < workspace.table_height)
        distance = (distance_transform_edt(~solid) - distance_transform_edt(solid)) * workspace.voxel_size
        tsdf = (distance / workspace.truncation).clip(-1, 1).astype(np.float32)
        grasp = antipodal_grasp(tsdf, workspace, self.gripper, self.rng)
        grasps = () if grasp is None else (grasp.moved(workspace.world_from_workspace),)
        return Detection(grasps, tsdf, {}, 0.0, {"hull": time.perf_counter() - start})


def main(scene: Path | None = None, out: Path = Path("outputs/hull")) -> None:
    """Detects in one scene; without --scene, in the first of the bundled ones."""
    views = read_scene(scene or demo_scenes()[0].folder)
    gripper = Gripper.load("panda")
    detector: Detector = VisualHull(gripper)
    detection = detector.detect(views)
    with whole_or_nothing(out) as part:
        write_prediction(part, views, detection, gripper)
        write_picture(part / "surface.png", surface_sheet(views, detection.tsdf))
    print(f"{len(detection.grasps)} grasp, {np.mean(detection.tsdf < 0):.0%} of the cube is matter")
    print(f"{out / 'overlay.png'}\n{out / 'surface.png'}")


if __name__ == "__main__":
    tyro.cli(main)
