"""A gripper of your own: one JSON file, which physics, labels, the width filter and the pictures all read.

    python examples/08_your_own_gripper.py

The file says how far the gripper opens, how deep its fingers are, where the TCP lies, and what can touch
something: boxes or convex hulls of the palm and of one finger (the other one is the same, turned by half a
turn), in metres, in a frame with its origin at the flange, z towards the finger tips and y along the line on
which the fingers close. Here it is written for a wide gripper made of boxes, and tried beside the Panda's on
a can of 9 cm, which does not fit between the Panda's fingers (needs `pip install 'neugrasp[sim]'`). Then give
the file wherever a gripper is asked for:

    neugrasp predict SCENE --out DIR --gripper outputs/gripper/wide.json
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import tyro

from neugrasp.baselines.antipodal import antipodal_grasp
from neugrasp.data.world import Body, Scene
from neugrasp.geometry.view_sets import view_set
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.observation import View
from neugrasp.pictures import draw_grasps, shade_surface, write_picture
from neugrasp.simulation.grasp_execution import execute
from neugrasp.simulation.gt_tsdf import scan
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World

WIDE = {
    "format": "neugrasp-gripper", "version": 1, "name": "wide",
    "max_opening": 0.15, "finger_depth": 0.06, "tcp_height": 0.13, "tcp_depth": 0.04,
    "closing_force": 30, "closing_speed": 0.2, "holding_force": 300, "centring_force": 50,
    "palm": {"mass": 0.8, "centre_of_mass": [0, 0, 0.04],
             "parts": [{"size": [0.06, 0.20, 0.08], "centre": [0, 0, 0.04]}]},
    "finger": {"mount": 0.08, "mass": 0.1, "centre_of_mass": [0, 0.01, 0.03],
               "pads": {"lateral_friction": 1.0, "spinning_friction": 0.1, "stiffness": 3e4, "damping": 1e3},
               "parts": [{"size": [0.024, 0.012, 0.06], "centre": [0, 0.006, 0.03]}]},
}  # fmt: skip


def main(tries: int = 5, out: Path = Path("outputs/gripper")) -> None:
    """Tries grasps of both grippers on the same can."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "wide.json").write_text(json.dumps(WIDE, indent=1))
    workspace, library = Workspace(), ObjectLibrary.open(["glassware"])
    can = Scene("single", 0, (Body("glassware", "can_013", 1.6, (0.15, 0.15, 0.11), (0.0, 0.0, 0.0, 1.0)),))
    for gripper in (Gripper.load("panda"), Gripper.load(out / "wide.json")):
        with World(workspace, library, gripper) as world:
            world.reset(can)
            world.settle()
            tsdf = scan(world, workspace).values
            rng = np.random.default_rng(0)
            drawn = [antipodal_grasp(tsdf, workspace, gripper, rng) for _ in range(tries)]
            grasps = [grasp for grasp in drawn if grasp is not None]
            print(f"{gripper.name} opens {gripper.max_opening * 1000:.0f} mm: {len(grasps)} grasps")
            for grasp in grasps:
                world.reset(can)
                world.settle()
                trial = execute(world, grasp, allow_contact=True)
                print(f"  {grasp.width * 1000:.0f} mm wide: {trial.reason}")
        camera = view_set("released", workspace, rng)[0]
        picture = shade_surface(tsdf, workspace, camera, size=camera.width)
        picture = draw_grasps(View(camera, picture, picture), grasps, gripper)
        write_picture(out / f"{gripper.name}.png", picture)
        print(f"  {out / gripper.name}.png")


if __name__ == "__main__":
    tyro.cli(main)
