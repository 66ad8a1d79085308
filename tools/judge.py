"""Measured objects in physics: where they rest, and what comes of a grasp."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from measured import Meshes, RealScene
from neugrasp.data.world import Body, Scene
from neugrasp.evaluation.protocols import protocol_of
from neugrasp.geometry.pose import Array, apply, from_quaternion
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.robot.pick import pick
from neugrasp.robot.simulated import SimulatedRobot
from neugrasp.simulation.physics import World
from neugrasp.simulation.surface import visible_surface

NUM_POINTS = 60_000
LIFT = 0.00025
"""Metres by which objects are raised at once until those that were measured into each other are free."""
TOUCHING = 0.0012
"""Metres by which bodies may overlap that rest on each other: the engine puts 1 mm around its shapes."""


class Judge:
    """Measured meshes in physics, on a table where the lowest of them stands."""

    def __init__(self, scene: RealScene, meshes: Meshes, gripper: Gripper):
        self.scene = scene
        lowest = min(float(thing.vertices[:, 2].min()) for thing in scene.things)
        self.world = World(
            Workspace(table_height=min(lowest, scene.views.workspace.table_height)), meshes, gripper
        )
        self.world.reset(Scene("packed", 0, tuple(thing.body for thing in scene.things)))
        self.truth = visible_surface(self.world, np.random.default_rng(0), NUM_POINTS).points
        self.laid, self.lifted_mm = self._freed()
        self.settled_mm = self._settled()

    def _freed(self) -> tuple[Scene, list[float]]:
        """The objects, raised where they were measured into each other, and by how many millimetres."""
        self.world.clear()
        bodies, lifted = [], []
        for thing in sorted(self.scene.things, key=lambda thing: float(thing.vertices[:, 2].min())):
            body, (x, y, z) = thing.body, thing.body.position
            index = self.world.add(body)
            self.world.detect_collisions()
            while self._overlap(index) > TOUCHING:
                body = replace(body, position=(x, y, body.position[2] + LIFT))
                self.world.place(index, body)
                self.world.detect_collisions()
            bodies.append(body)
            lifted.append(1000 * (body.position[2] - z))
        return Scene("packed", 0, tuple(bodies)), lifted

    def _overlap(self, index: int) -> float:
        """Metres by which a body reaches into another one or into the table; `World` says only whether it is
        near them."""
        client, placed = self.world._client, self.world._placed[index]
        return max((-contact[8] for contact in client.getContactPoints(placed.uid)), default=0.0)

    def _settled(self) -> list[float]:
        """Millimetres by which each object moves when it is let go."""
        self.world.reset(self.laid)
        self.world.rest()
        middle = {thing.name: thing.mesh.middle for thing in self.scene.things}
        pairs = zip(self.laid.bodies, self.world.bodies(), strict=True)
        places = [[apply(_pose(body), middle[body.name]) for body in pair] for pair in pairs]
        return [1000 * float(np.linalg.norm(before - after)) for before, after in places]

    def grasp(self, grasp: Grasp) -> dict[str, Any]:
        """What comes of a grasp (workspace frame), and where it is."""
        robot = SimulatedRobot(self.world, self.laid)
        opening = protocol_of("paper").min_opening * robot.max_opening
        reason = pick(robot, robot, grasp, opening, np.array([0.0, 0.0, 1.0])).reason
        return {
            "score": grasp.score,
            "width_mm": 1000 * grasp.width,
            **self._off_axis(grasp),
            "tilt_deg": float(np.rad2deg(np.arccos(np.clip(-grasp.approach[2], -1, 1)))),
            "reason": reason,
        }

    def _off_axis(self, grasp: Grasp) -> dict[str, Any]:
        """The nearest round object, and millimetres from its axis, in all and along the closing."""
        rounds = [(i, thing) for i, thing in enumerate(self.scene.things) if thing.axis]
        if not rounds:
            return {}
        number, thing = min(
            rounds, key=lambda one: float(np.linalg.norm(one[1].from_axis(grasp.position[None])))
        )
        offset = 1000 * thing.from_axis(grasp.position[None])[0]
        sideways = abs(float(offset @ grasp.pose[:3, 1]))
        return {"object": number, "off_axis_mm": float(np.linalg.norm(offset)), "sideways_mm": sideways}


def _pose(body: Body) -> Array:
    return from_quaternion(body.quaternion_xyzw, body.position)
