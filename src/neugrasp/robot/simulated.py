"""A robot cell in physics, behind the protocols of `robot.interface`.

The user's world is the workspace frame here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from neugrasp.data.world import Body, Material, Scene
from neugrasp.detection.contract import Detection
from neugrasp.geometry.pose import Array
from neugrasp.grasp import Grasp
from neugrasp.simulation.physics import World


class SimulatedRobot:
    """Arm, gripper and table in one world, which it alone may change as long as it is used."""

    def __init__(self, world: World, scene: Scene, table_contact: bool = True):
        """Lays `scene` into `world`. Without `table_contact` the hand does not feel the table."""
        self._world = world
        self._scene = scene
        self._table_contact = table_contact
        world.reset(scene)

    @property
    def max_opening(self) -> float:
        """Largest distance between the pads, metres."""
        return self._world.gripper.max_opening

    def scene(self) -> Scene:
        """What lies on the table now, each body with its material."""
        return replace(self._scene, bodies=self._world.bodies())

    def count(self) -> int:
        """How many objects lie in the workspace."""
        return len(self._world.bodies())

    def move_to_pose(self, world_from_tcp: Array) -> bool:
        """Puts the open hand at a pose; False where it touches something there."""
        self._world.hand().place(world_from_tcp)
        self._world.detect_collisions()
        return not self._touches()

    def move_straight(self, position: Array, stop_on_contact: bool) -> bool:
        """Leads the hand along a line; whether a contact stopped it."""
        self._world.hand().move(position, until=self._touches if stop_on_contact else _never)
        return stop_on_contact and self._touches()

    def prepare(self, grasp: Grasp, detection: Detection) -> SimulatedRobot:
        """Nothing to do: a hand that floats gets everywhere, or touches something there."""
        return self

    def place_in_bin(self) -> bool:
        """Takes the object in the hand and the hand out of the world; the rest settles."""
        held = self._world.held()
        if held is not None:
            self._world.remove(held)
            kept = [m for i, m in enumerate(self._scene.materials) if i != held]
            self._scene = replace(self._scene, materials=tuple(kept))
        self.retract()
        return True

    def retract(self) -> None:
        """Takes the hand out of the world; the rest settles, and what lies outside the workspace is gone."""
        self._world.remove_hand()
        before = self._world.bodies()
        self._world.settle()
        if self._scene.materials:
            materials = _of_those_left(before, self._world.bodies(), self._scene.materials)
            self._scene = replace(self._scene, materials=materials)

    def open(self) -> None:
        """Nothing to do: `move_to_pose` brings the hand open."""

    def close(self) -> None:
        """Closes for half a second; the fingers go on pressing."""
        self._world.hand().close()

    def opening(self) -> float:
        """The distance between the pads, metres."""
        return self._world.hand().opening()

    def holds(self) -> bool:
        """Whether an object touches the hand."""
        return self._world.held() is not None

    def _touches(self) -> bool:
        return self._world.hand().touches() if self._table_contact else self.holds()


def _never() -> bool:
    return False


def _of_those_left(
    before: Sequence[Body], after: Sequence[Body], materials: Sequence[Material]
) -> tuple[Material, ...]:
    """The materials of the bodies that stayed. Bodies keep their order; two that are alike in object and
    scale, which random scales do not let happen, could swap materials."""
    kept, rest = [], iter(zip(before, materials, strict=True))
    for body in after:
        kept.append(next(material for old, material in rest if _identity(old) == _identity(body)))
    return tuple(kept)


def _identity(body: Body) -> tuple[str, str, float]:
    return body.object_set, body.name, body.scale
