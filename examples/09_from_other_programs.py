"""Photos and cameras from nerfstudio in, grasps for MoveIt and graspnetAPI out.

    python examples/09_from_other_programs.py

A reconstruction has cameras in a frame and a unit of its own. Two things make a scene of it: a photo of the
empty table for each photo, and where the cube lies. A printed board in the photos says that by itself
(docs/capture.md); here an alignment file does: how many metres a unit has, and two poses. `capture` stands
for your reconstruction: it writes a bundled scene the way nerfstudio would have. As commands:

    cd outputs
    neugrasp import nerfstudio foreign --alignment foreign/alignment.json --out imported
    neugrasp predict imported --out grasps
    neugrasp export grasps/grasps.json --format ros --frame-id base_link
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import tyro
from PIL import Image

from neugrasp.data.scene_folder import read_scene
from neugrasp.demo.bundled import demo_scenes
from neugrasp.detection.registry import load_detector
from neugrasp.exporters import graspnet, ros
from neugrasp.geometry.pose import inverse, rigid, rotation_about
from neugrasp.importers.command import Import
from neugrasp.importers.import_scene import import_scene

METRES_PER_UNIT = 0.25
WORLD_FROM_RECONSTRUCTION = rigid(rotation_about((1, 0, 0), 0.4), (0.1, 0.2, 0.3))


def capture(source: Path, folder: Path) -> None:
    """transforms.json, images/, backgrounds/ and alignment.json; replace it by your reconstruction."""
    scene, frames = read_scene(source), []
    for i, view in enumerate(scene.frames):
        for kind, pixels in (("images", view.image), ("backgrounds", view.background)):
            (folder / kind).mkdir(parents=True, exist_ok=True)
            Image.fromarray(pixels).save(folder / kind / f"{i}.png")
        pose = inverse(WORLD_FROM_RECONSTRUCTION) @ view.camera.world_from_camera
        pose[:3, 3] /= METRES_PER_UNIT
        (fx, _, cx), (_, fy, cy), _ = view.camera.intrinsics.tolist()
        lens = {"fl_x": fx, "fl_y": fy, "cx": cx + 0.5, "cy": cy + 0.5}
        lens["h"], lens["w"] = view.image.shape[:2]
        matrix = (pose @ np.diag([1, -1, -1, 1])).tolist()  # OpenGL axes
        frames.append({"file_path": f"images/{i}.png", "transform_matrix": matrix, **lens})
    (folder / "transforms.json").write_text(json.dumps({"frames": frames}))
    alignment = {
        "metres_per_unit": METRES_PER_UNIT,
        "world_from_reconstruction": WORLD_FROM_RECONSTRUCTION.tolist(),
        "world_from_workspace": scene.workspace.world_from_workspace.tolist(),
    }
    (folder / "alignment.json").write_text(json.dumps(alignment))


def main(source: Path | None = None, weights: str = "neugrasp", out: Path = Path("outputs")) -> None:
    """Imports, predicts and exports."""
    foreign = out / "foreign"
    capture(source or demo_scenes()[0].folder, foreign)
    alignment = foreign / "alignment.json"
    run = Import(format="nerfstudio", source=foreign, out=out / "imported", alignment=alignment)
    detector = load_detector(weights=weights)
    grasps = detector.detect(import_scene(run)).grasps
    ros.write(out / "grasps_ros.json", grasps, detector.gripper, ros.Stamp("base_link"))
    graspnet.write(out / "grasps.npy", grasps, detector.gripper)
    print(f"{len(grasps)} grasps in {out / 'grasps_ros.json'} and {out / 'grasps.npy'}")


if __name__ == "__main__":
    tyro.cli(main)
