"""The gripper as a floating hand in a physics world: placed anywhere, moved along lines, closed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.geometry.pose import Array, from_quaternion, inverse, rigid, to_quaternion
from neugrasp.grasp import APPROACH
from neugrasp.gripper import Gripper

LEFT, RIGHT = 0, 1
"""Link numbers of the finger on the side of +y and of the other one."""
STEP_LENGTH = 0.002
"""Metres by which the target moves at once on a line."""
STEPS_PER_MOVE = 4
"""Physics steps for each of them: 0.12 m/s at 240 steps a second (the reference's 0.10 m/s, truncated)."""
CLOSING_STEPS = 120
"""Half a second."""
CARRY_STEP = 0.004
"""Metres between the places where a way is looked at."""
PARKING = (0.0, 0.0, 5.0)


@dataclass(frozen=True)
class Motion:
    """A hand at one moment, in the engine's terms."""

    pose: tuple[Any, Any]
    """Position and quaternion of the body."""
    velocity: tuple[Any, Any]
    """Linear and angular."""
    fingers: tuple[tuple[float, float], ...]
    """Position and speed of each."""
    target: tuple[Any, Any]
    """Where the arm pulls the body to."""


class Hand:
    """One gripper in the world behind `client`. Poses are those of the TCP: z approaches, y closes."""

    def __init__(self, client: Any, gripper: Gripper, urdf: Path):
        self.gripper = gripper
        self._client = client
        self._time_step = float(client.getPhysicsEngineParameters()["fixedTimeStep"])
        self._tcp_from_body = rigid(translation=(0, 0, -gripper.tcp_height)) @ rigid(
            translation=gripper.palm.centre_of_mass
        )
        self.uid: int = client.loadURDF(str(urdf))
        self._hold = client.createConstraint(
            self.uid, -1, -1, -1, client.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 0]
        )
        gear = client.createConstraint(
            self.uid, LEFT, self.uid, RIGHT, client.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0]
        )
        client.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=gripper.centring_force)
        for finger in (LEFT, RIGHT):
            client.changeDynamics(
                self.uid,
                finger,
                lateralFriction=gripper.pads.lateral_friction,
                spinningFriction=gripper.pads.spinning_friction,
                contactStiffness=gripper.pads.stiffness,
                contactDamping=gripper.pads.damping,
                frictionAnchor=1,
            )
        self.park()

    def park(self) -> None:
        """Out of reach of everything."""
        self.place(rigid(translation=PARKING))

    def place(self, world_from_tcp: Array) -> None:
        """The open hand at rest at a pose, whatever it did before."""
        pose = world_from_tcp @ self._tcp_from_body
        quaternion = to_quaternion(pose)
        self._client.resetBasePositionAndOrientation(self.uid, pose[:3, 3], quaternion)
        self._client.resetBaseVelocity(self.uid, [0, 0, 0], [0, 0, 0])
        self._target(pose[:3, 3], quaternion)
        for finger in (LEFT, RIGHT):
            self._client.resetJointState(self.uid, finger, self.gripper.max_opening / 2, 0.0)
            self._client.setJointMotorControl2(
                self.uid, finger, self._client.VELOCITY_CONTROL, targetVelocity=0, force=1.0
            )

    def body_positions(self, world_from_tcp: Array) -> Array:
        """Where the body is (n, 3), its TCP being at poses (n, 4, 4): for `show`."""
        return np.asarray(world_from_tcp @ self._tcp_from_body)[:, :3, 3]

    def show(self, position: Sequence[float], quaternion_xyzw: Sequence[float]) -> None:
        """Puts the body somewhere as it is, to look for collisions only."""
        self._client.resetBasePositionAndOrientation(self.uid, position, quaternion_xyzw)

    def pose(self) -> Array:
        """Where the TCP is: `world_from_tcp`."""
        position, quaternion = self._client.getBasePositionAndOrientation(self.uid)
        return from_quaternion(quaternion, position) @ inverse(self._tcp_from_body)

    def approached(self, world_from_tcp: Array) -> Motion:
        """The open hand at the end of an approach, which it carries out. Time passes."""
        start = world_from_tcp.copy()
        start[:3, 3] -= APPROACH * start[:3, 2]
        self.place(start)
        self.move(world_from_tcp[:3, 3], until=lambda: False)
        client = self._client
        states = client.getJointStates(self.uid, (LEFT, RIGHT))
        return Motion(
            client.getBasePositionAndOrientation(self.uid),
            client.getBaseVelocity(self.uid),
            tuple((position, speed) for position, speed, *_ in states),
            self._aim,
        )

    def resume(self, motion: Motion) -> None:
        """The open hand as it was at another moment."""
        self.park()
        self._client.resetBasePositionAndOrientation(self.uid, *motion.pose)
        self._client.resetBaseVelocity(self.uid, *motion.velocity)
        for finger, state in zip((LEFT, RIGHT), motion.fingers, strict=True):
            self._client.resetJointState(self.uid, finger, *state)
        self._target(*motion.target)

    def try_approach(self) -> tuple[float, ...]:
        """Metres by which the hand is short of a grasp at each look for contacts on its approach.

        One is carried out in the parking place, where nothing can be touched. Time passes.
        """
        goal = rigid(translation=PARKING)
        goal[2, 3] += APPROACH
        self.park()
        short: list[float] = []

        def note() -> bool:
            # The engine looks for contacts at the beginning of a step, before it moves anything.
            speed = self._client.getBaseVelocity(self.uid)[0][2]
            short.append(float(goal[2, 3] - self.pose()[2, 3] + speed * self._time_step))
            return False

        self.move(goal[:3, 3], until=note)
        self.park()
        return tuple(short)

    def move(self, position: Array, until: Callable[[], bool]) -> None:
        """Leads the TCP along a line to a position; the orientation stays. Ends early once `until`."""
        pose = self.pose()
        way = position - pose[:3, 3]
        moves = max(1, round(float(np.linalg.norm(way)) / STEP_LENGTH))
        body = pose @ self._tcp_from_body
        quaternion = to_quaternion(body)
        for _ in range(moves):
            body[:3, 3] += way / moves
            self._target(body[:3, 3], quaternion)
            self._step(STEPS_PER_MOVE)
            if until():
                return

    def close(self, until: Callable[[], bool] | None = None) -> None:
        """Half a second of closing, less once `until`; the fingers go on pressing afterwards."""
        for finger in (LEFT, RIGHT):
            self._client.setJointMotorControl2(
                self.uid,
                finger,
                self._client.POSITION_CONTROL,
                targetPosition=0.0,
                force=self.gripper.closing_force,
            )
        for _ in range(CLOSING_STEPS // STEPS_PER_MOVE):
            self._step(STEPS_PER_MOVE)
            if until is not None and until():
                return

    def opening(self) -> float:
        """The distance between the pads, metres."""
        return float(sum(state[0] for state in self._client.getJointStates(self.uid, (LEFT, RIGHT))))

    def finger_speeds(self) -> list[float]:
        """Speeds of both fingers, m/s."""
        return [abs(state[1]) for state in self._client.getJointStates(self.uid, (LEFT, RIGHT))]

    def touches(self) -> bool:
        """Whether the hand touched anything, the table included, when collisions were last computed."""
        return len(self._client.getContactPoints(self.uid)) > 0

    def touched(self) -> tuple[int, ...]:
        """The engine's numbers of what the hand touched, in the order of the contacts."""
        return tuple(int(point[2]) for point in self._client.getContactPoints(self.uid))

    def holds(self) -> int | None:
        """The engine's number of the one body that the hand touches and that touches nothing else."""
        touched = set(self.touched())
        if len(touched) != 1:
            return None
        (uid,) = touched
        is_alone = all(point[2] == self.uid for point in self._client.getContactPoints(uid))
        return uid if is_alone else None

    def slip(self, uid: int, lever: float) -> float:
        """How fast a body moves in the hand, m/s; a turn counts at the end of a lever, metres."""
        (linear, angular), (own, own_turn) = (self._client.getBaseVelocity(u) for u in (uid, self.uid))
        sliding = [a - b for a, b in zip(linear, own, strict=True)]
        turning = [lever * (a - b) for a, b in zip(angular, own_turn, strict=True)]
        return float(np.linalg.norm([*sliding, *turning, *self.finger_speeds()]))

    def can_carry(self, uid: int, goal: Array) -> bool:
        """Whether hand and held body, stiff as one, touch nothing else as the TCP goes to a position."""
        client, pair = self._client, (self.uid, uid)
        poses = [client.getBasePositionAndOrientation(body) for body in pair]
        speeds = [client.getBaseVelocity(body) for body in pair]
        way = goal - self.pose()[:3, 3]
        count = max(1, round(float(np.linalg.norm(way)) / CARRY_STEP))
        is_free = True
        for offset in np.linspace(1, 0, count, endpoint=False)[:, None] * way:
            for body, (position, quaternion) in zip(pair, poses, strict=True):
                client.resetBasePositionAndOrientation(body, (offset + position).tolist(), quaternion)
            client.performCollisionDetection()
            is_free = self.holds() == uid
            if not is_free:
                break
        for body, pose, speed in zip(pair, poses, speeds, strict=True):
            client.resetBasePositionAndOrientation(body, *pose)
            client.resetBaseVelocity(body, *speed)
        client.performCollisionDetection()
        return is_free

    def _target(self, position: Array, quaternion_xyzw: Array) -> None:
        """Where the arm pulls the body (its centre of mass) to."""
        self._aim = (np.array(position), np.array(quaternion_xyzw))
        self._client.changeConstraint(
            self._hold, position, quaternion_xyzw, maxForce=self.gripper.holding_force
        )

    def _step(self, count: int) -> None:
        for _ in range(count):
            self._client.stepSimulation()
