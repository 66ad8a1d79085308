"""The physics of a table with objects: the only file that imports PyBullet.

Poses are in the workspace frame, which is PyBullet's world. Numbers follow VGN's released simulator.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from neugrasp.data.world import Body, Scene
from neugrasp.errors import InputError, require
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.simulation.arm import JointedArm
from neugrasp.simulation.arm_urdf import write_arm
from neugrasp.simulation.body_freezing import Freezer
from neugrasp.simulation.depth import plane_depth, rendered
from neugrasp.simulation.hand import Hand
from neugrasp.simulation.placed import Placed
from neugrasp.simulation.silence import quiet
from neugrasp.simulation.urdf import write_gripper, write_object

if TYPE_CHECKING:
    from neugrasp.simulation.objects import ObjectModel

TIME_STEP = 1 / 240
SOLVER_ITERATIONS = 150
TABLE_SIZE = 1.2
"""Edge of the square table, metres."""
TABLE_FRICTION = 0.5
REST_SPEED = 0.01
"""A body rests below this norm of (velocity, angular velocity), m/s and rad/s."""
REST_CHECK = 60
"""Physics steps between two looks at whether all bodies rest."""
TRAY_SIZE, TRAY_HEIGHT, TRAY_WALL = 0.26, 0.13, 0.013
"""The open tray into which piles are dropped, metres."""


class Library(Protocol):
    """Where object models come from."""

    def model(self, object_set: str, name: str) -> ObjectModel: ...


class World:
    """A table, bodies on it and a gripper. One engine per world; close it or use it as a context."""

    def __init__(self, workspace: Workspace, library: Library, gripper: Gripper | None = None):
        self.workspace = workspace
        self.gripper = gripper or Gripper.load("panda")
        self._library = library
        with quiet():
            require("pybullet", extra="sim")
            from pybullet_utils.bullet_client import BulletClient

            self._client: Any = BulletClient(connection_mode=require("pybullet", extra="sim").DIRECT)
        self._temporary = TemporaryDirectory(prefix="neugrasp-world-")
        self._folder = Path(self._temporary.name)
        self._hand_urdf = write_gripper(self.gripper, self._folder)
        self._urdfs: dict[tuple[str, str], Path] = {}
        self._placed: list[Placed] = []
        self._hand: Hand | None = None
        self._arm: JointedArm | None = None
        self.clear()
        self.approach = self.hand().try_approach()
        """Metres by which the hand is short of a grasp at each look for contacts on its approach."""
        self.clear()

    def __enter__(self) -> World:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the engine."""
        self._client.disconnect()
        self._temporary.cleanup()

    def clear(self) -> None:
        """The empty table."""
        client = self._client
        client.resetSimulation()
        client.setPhysicsEngineParameter(
            fixedTimeStep=TIME_STEP, numSolverIterations=SOLVER_ITERATIONS, deterministicOverlappingPairs=1
        )
        client.setGravity(0, 0, -9.81)
        self._placed, self._hand, self._arm = [], None, None
        half = TABLE_SIZE / 2
        x, y, z = self.workspace.centre
        shape = client.createCollisionShape(client.GEOM_BOX, halfExtents=[half] * 3)
        table = client.createMultiBody(0, shape, self._unseen(), [x, y, z - half])
        client.changeDynamics(table, -1, lateralFriction=TABLE_FRICTION)

    def _unseen(self) -> int:
        """A visual shape of no size: without any, the renderer would draw the collision shape. The table
        is added to images in closed form, which is exact and spares the time of two large triangles."""
        return int(self._client.createVisualShape(self._client.GEOM_BOX, halfExtents=[1e-6] * 3))

    def reset(self, scene: Scene) -> None:
        """Exactly the bodies of a scene, at rest, whatever was there before."""
        self.clear()
        for body in scene.bodies:
            self.add(body)

    def add(self, body: Body) -> int:
        """Puts a body in and returns its number. Raises `InputError` where the object is unusable."""
        model = self.model(body)
        urdf = self._urdf_of(body, model)
        try:
            uid = self._client.loadURDF(str(urdf), globalScaling=body.scale)
        except self._client.error as error:
            meshes = ", ".join(str(path) for path in (model.visual_mesh, *model.collision_meshes))
            raise InputError(f"{meshes}: the physics engine cannot load this object ({error})") from error
        turn = Rotation.from_euler("xyz", model.inertial_rpy) if any(model.inertial_rpy) else None
        self._placed.append(Placed(uid, body, np.array(model.centre_of_mass) * body.scale, turn))
        self.place(len(self._placed) - 1, body)
        return len(self._placed) - 1

    def model(self, body: Body) -> ObjectModel:
        """The object that a body is."""
        return self._library.model(body.object_set, body.name)

    def _urdf_of(self, body: Body, model: ObjectModel) -> Path:
        """The description of an object for the engine's loader, written once.

        It must be loaded from a file as the reference does: bodies made through the programming interface
        get another inertia where the collision shape has several parts. The mass is the same at every
        scale, and the inertia is computed from the collision shape.
        """
        key = (body.object_set, body.name)
        if key not in self._urdfs:
            self._urdfs[key] = write_object(model, self._folder / f"object_{len(self._urdfs)}.urdf")
        return self._urdfs[key]

    def place(self, index: int, body: Body) -> None:
        """Teleports a body to the pose of `body`, at rest."""
        placed = self._placed[index]
        self._client.resetBasePositionAndOrientation(placed.uid, *placed.placing(body))
        self._client.resetBaseVelocity(placed.uid, [0, 0, 0], [0, 0, 0])

    def remove(self, index: int) -> None:
        """Takes a body out; the numbers of later ones move down."""
        self._client.removeBody(self._placed.pop(index).uid)

    def bodies(self) -> tuple[Body, ...]:
        """All bodies where they are now."""
        return tuple(self._current(placed) for placed in self._placed)

    def _current(self, placed: Placed) -> Body:
        return placed.body_at(*self._client.getBasePositionAndOrientation(placed.uid))

    def bottom(self, index: int) -> float:
        """How low a body's bounding box reaches, metres."""
        low, _ = self._client.getAABB(self._placed[index].uid)
        return float(low[2])

    def touches(self, index: int) -> bool:
        """Whether a body touched anything when collisions were last computed."""
        return len(self._client.getContactPoints(self._placed[index].uid)) > 0

    def held(self) -> int | None:
        """The number of the first body that the hand touches; None where it touches none."""
        numbers = {placed.uid: i for i, placed in enumerate(self._placed)}
        touched = self._arm.held() if self._arm else self._hand.touched() if self._hand else ()
        return next((numbers[uid] for uid in touched if uid in numbers), None)

    def nearest(self, point: Array) -> int | None:
        """The number of the body whose collision shape is nearest to a point (3,), workspace frame, metres;
        None where there are no bodies."""
        ask, far = self._client.getClosestPoints, 10 * self.workspace.size
        ball = self._client.createCollisionShape(self._client.GEOM_SPHERE, radius=1e-4)
        place = {"collisionShapeB": ball, "collisionShapePositionB": list(point)}
        distances = [min(pair[8] for pair in ask(p.uid, -1, far, **place)) for p in self._placed]
        return int(np.argmin(distances)) if distances else None

    def step(self, count: int = 1) -> None:
        """Lets 1/240 s pass, `count` times."""
        for _ in range(count):
            self._client.stepSimulation()

    def detect_collisions(self) -> None:
        """Brings contacts up to date with poses without letting time pass."""
        self._client.performCollisionDetection()

    def rest(self, timeout: float = 2.0) -> bool:
        """Waits until all bodies rest, at most `timeout` seconds; whether they do."""
        self.remove_hand()
        for _ in range(round(timeout / TIME_STEP / REST_CHECK)):
            self.step(REST_CHECK)
            if all(self._speed(placed) <= REST_SPEED for placed in self._placed):
                return True
        return False

    def _speed(self, placed: Placed) -> float:
        linear, angular = self._client.getBaseVelocity(placed.uid)
        return float(np.linalg.norm([*linear, *angular]))

    def settle(self) -> None:
        """Waits until all bodies rest and takes out those that left the workspace, until none does."""
        while True:
            self.rest()
            positions = [self._client.getBasePositionAndOrientation(p.uid)[0] for p in self._placed]
            size = self.workspace.size
            gone = [i for i, xyz in enumerate(positions) if min(xyz) < 0 or max(xyz) > size]
            for index in reversed(gone):
                self.remove(index)
            if not gone:
                return

    @contextlib.contextmanager
    def tray(self) -> Iterator[None]:
        """An open tray around the middle of the table, gone when the context ends."""
        client, wall, height = self._client, TRAY_WALL / 2, TRAY_HEIGHT / 2
        side = TRAY_SIZE / 2
        halves = [[wall, side, height]] * 2 + [[side, wall, height]] * 2
        centres = [[s * (side - wall), 0, height] for s in (-1, 1)] + [
            [0, s * (side - wall), height] for s in (-1, 1)
        ]
        shape = client.createCollisionShapeArray(
            [client.GEOM_BOX] * 4, halfExtents=halves, collisionFramePositions=centres
        )
        tray = client.createMultiBody(0, shape, self._unseen(), self.workspace.centre)
        client.changeDynamics(tray, -1, lateralFriction=TABLE_FRICTION)
        try:
            yield
        finally:
            client.removeBody(tray)

    def hand(self) -> Hand:
        """The gripper, brought in where it is not there yet."""
        if self._hand is None:
            self._hand = Hand(self._client, self.gripper, self._hand_urdf)
        return self._hand

    def remove_hand(self) -> None:
        """Takes the gripper out; a saved state that has it can no longer be restored."""
        if self._hand is not None:
            self._client.removeBody(self._hand.uid)
            self._hand = None

    def mount(self, model: str, world_from_base: Array, flange_from_hand: Array) -> JointedArm:
        """Brings in an arm that carries the gripper; `clear` and `reset` take it out again."""
        path = self._folder / f"{model}.urdf"
        urdf = write_arm(model, self._hand_urdf, flange_from_hand, path)
        self._arm = JointedArm(self._client, self.gripper, urdf, world_from_base)
        return self._arm

    def save(self) -> int:
        """The name of the present state; valid as long as no body and no gripper comes or goes."""
        if self._hand is not None:
            self._hand.park()
        # Contacts that a saved state does not know survive its restoring and change what follows.
        self._client.performCollisionDetection()
        return int(self._client.saveState())

    def restore(self, state: int) -> None:
        """Goes back to a saved state, exactly: what follows does not depend on what happened since."""
        self._client.restoreState(state)
        if self._hand is not None:
            self._hand.park()
        self._client.performCollisionDetection()

    def forget(self, state: int) -> None:
        """Frees a saved state."""
        self._client.removeState(state)

    def freezer(self) -> Freezer:
        """What can freeze the bodies that are there now."""
        return Freezer(self._client, [placed.uid for placed in self._placed])

    def depth_and_mask(self, camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.int16]]:
        """z-depth in metres (h, w), 0 where nothing is, and what is seen (h, w): -1 nothing, 0 the table,
        i + 1 the body i. The camera is in the workspace frame; the gripper is not seen."""
        depth, uids = rendered(self._client, camera)
        table = plane_depth(camera, self.workspace.centre, TABLE_SIZE)
        mask = np.full(depth.shape, -1, dtype=np.int16)
        for i, placed in enumerate(self._placed):
            mask[uids == placed.uid] = i + 1
        mask[table < depth] = 0
        depth = np.minimum(depth, table)
        return np.where(np.isfinite(depth), depth, 0).astype(np.float32), mask
