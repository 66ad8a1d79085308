"""Boxes whose size is in their name, a world to put them in, and a detector that knows where they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from neugrasp.data.world import Body, Material, Scene
from neugrasp.detection.contract import Detection
from neugrasp.geometry.pose import from_quaternion, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.simulation.objects import ObjectModel
from neugrasp.simulation.physics import World

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
DOWN = np.diag([1.0, -1.0, -1.0])


class Boxes:
    """The library: "0.03 0.05 0.06" is a box of these edges in metres."""

    def __init__(self, folder: Path):
        self.folder = folder

    def model(self, object_set: str, name: str) -> ObjectModel:
        path = self.folder / f"{name.replace(' ', '_')}.obj"
        if not path.exists():
            trimesh.creation.box([float(edge) for edge in name.split()]).export(path, include_normals=False)
        return ObjectModel(name, path, (path,), mass=0.1)


def box(x: float, y: float, name: str = "0.03 0.05 0.06") -> Body:
    """A box that stands on the table."""
    return Body("boxes", name, 1.0, (x, y, 0.05 + float(name.split()[2]) / 2), UPRIGHT)


def boxes_scene(*bodies: Body) -> Scene:
    """The bodies, each with a material of its own name."""
    materials = tuple(Material("diffuse", f"material {i}", {"number": i}) for i in range(len(bodies)))
    return Scene("packed", 0, bodies, materials)


def grasp_of(body: Body, depth: float = 0.02) -> Grasp:
    """From straight above, closing along the box's x edge, `depth` metres below its top."""
    world_from_body = from_quaternion(body.quaternion_xyzw, body.position)
    height = float(body.name.split()[2])
    closing_along_x = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    top = rigid(closing_along_x, (0, 0, height / 2 - depth))
    return Grasp(world_from_body @ top, float(body.name.split()[0]))


def detection(*grasps: Grasp) -> Detection:
    """These grasps, and a surface that is nowhere."""
    workspace, gripper = Workspace(), Gripper.load("panda")
    nowhere = np.ones((workspace.resolution,) * 3, dtype=np.float32)
    return Detection(Grasps.of(grasps), workspace, gripper, nowhere, timing_s={"network": 0.1})


class Cheat:
    """Knows every box; looks at nothing that it is shown."""

    def __init__(self, world: World):
        self.world = world

    def detect(self, views: object) -> Detection:
        return detection(*(grasp_of(body) for body in self.world.bodies()))


class AirGrasper:
    """Grasps where nothing is."""

    def detect(self, views: object) -> Detection:
        return detection(Grasp(rigid(DOWN, (0.15, 0.15, 0.25)), 0.04))


class Blind:
    """Detects nothing."""

    def detect(self, views: object) -> Detection:
        return detection()
