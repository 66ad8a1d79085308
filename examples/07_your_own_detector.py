"""A detector of your own: anything that turns an `Observation` into a `Detection`.

    python examples/07_your_own_detector.py --scene outputs/glass

This one has learned nothing. Where a photo looks like that of the empty table, there is nothing between
camera and table; what no view has emptied is matter: the visual hull. It works on glass, which changes the
picture, too. From a narrow arc of views it is too high, and it has no hollows: compare surface.png with the
photos. One antipodal grasp is drawn on it at random.

With `SPEC` it predicts like the network, and plays the benchmark (`neugrasp evaluate --detector`), too:

    PYTHONPATH=examples neugrasp predict SCENE --out DIR --detector 07_your_own_detector:SPEC
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tyro
from scipy.ndimage import binary_closing, binary_fill_holes, binary_opening, distance_transform_edt

from neugrasp.baselines.antipodal import antipodal_grasp
from neugrasp.data.scene_folder import read_scene
from neugrasp.demo.bundled import demo_scenes
from neugrasp.detection.contract import Detection
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import PHOTOS, DetectorSpec
from neugrasp.grasp import Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Observation, with_backgrounds
from neugrasp.pictures import surface_sheet, write_picture

CHANGED = 20
"""Of 255: how much a pixel differs from the empty table where something stands in front of it."""


class VisualHull:
    """Carves away what the unchanged pixels have seen to be empty."""

    def __init__(self, gripper: Gripper, seed: int = 0):
        self.gripper, self.rng = gripper, np.random.default_rng(seed)

    def detect(self, observation: Observation) -> Detection:
        """One grasp, or none."""
        views = with_backgrounds(observation)
        workspace = views.workspace
        points = workspace.voxel_centres()
        matter = points[..., 2] > workspace.table_height
        for view in views.frames:
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
        found = [] if grasp is None else [grasp.moved(workspace.world_from_workspace)]
        return Detection(Grasps.of(found), workspace, self.gripper, tsdf)


SPEC = DetectorSpec(PHOTOS, lambda options: VisualHull(Gripper.load(options.gripper), options.seed))


def main(scene: Path | None = None, out: Path = Path("outputs/hull")) -> None:
    """Detects in one scene; without --scene, in the first of the bundled ones."""
    views = read_scene(scene or demo_scenes()[0].folder)
    detection = SPEC.load(DetectorOptions()).detect(views)
    detection.save(out, views)
    write_picture(out / "surface.png", surface_sheet(views, detection.grid()))
    print(f"{detection.grasps}, {np.mean(detection.grid() < 0):.0%} of the cube is matter: {out}/surface.png")


if __name__ == "__main__":
    tyro.cli(main)
