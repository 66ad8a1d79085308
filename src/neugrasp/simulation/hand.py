"""The gripper as a floating hand in a physics world: placed anywhere, moved along lines, closed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.geometry.pose import Array, from_quaternion, inverse, rigid, to_quaternion
from neugrasp.gripper import Gripper

LEFT, RIGHT = 0, 1
"""Link numbers of the finger on the side of +y and of the other one."""
STEP_LENGTH = 0.002
"""Metres by which the target moves at once on a line."""
STEPS_PER_MOVE = 4
"""Physics steps for each of them: 0.12 m/s at 240 steps a second (the reference's 0.10 m/s, truncated)."""
APPROACH = 0.05
"""Metres from the pre-grasp to the grasp."""
APPROACH_STEPS = round(APPROACH / STEP_LENGTH) * STEPS_PER_MOVE
CLOSING_STEPS = 120
"""Half a second."""
PARKING = (0.0, 0.0, 5.0)


@dataclass(frozen=True)
class Approach:
    """How the hand follows its target on the way to a grasp."""

    lag: float
    """Metres by which it is short of the grasp at the end."""
    speed: float
    """Its speed at the end, m/s."""
    short: tuple[float, ...]
    """Metres by which it is short of the grasp where the engine looks for the contacts of each move."""


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

    def shift(self, position: Array) -> None:
        """Puts the TCP somewhere else with the same orientation, to look for collisions only."""
        _, quaternion = self._client.getBasePositionAndOrientation(self.uid)
        offset = from_quaternion(quaternion)[:3, :3] @ self._tcp_from_body[:3, 3]
        self._client.resetBasePositionAndOrientation(self.uid, (position + offset).tolist(), quaternion)

    def pose(self) -> Array:
        """Where the TCP is: `world_from_tcp`."""
        position, quaternion = self._client.getBasePositionAndOrientation(self.uid)
        return from_quaternion(quaternion, position) @ inverse(self._tcp_from_body)

    def arrive(self, world_from_tcp: Array, approach: Approach) -> None:
        """The open hand as it is at the end of a straight approach on which it touched nothing."""
        pose, direction = world_from_tcp.copy(), world_from_tcp[:3, 2]
        pose[:3, 3] -= approach.lag * direction
        self.place(pose)
        self._client.resetBaseVelocity(self.uid, (approach.speed * direction).tolist(), [0, 0, 0])
        body = world_from_tcp @ self._tcp_from_body
        self._target(body[:3, 3], to_quaternion(body))

    def try_approach(self) -> Approach:
        """Carries out an approach in the parking place, where nothing can be touched. Time passes."""
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
        lag = float(goal[2, 3] - self.pose()[2, 3])
        speed = float(self._client.getBaseVelocity(self.uid)[0][2])
        self.park()
        return Approach(lag, speed, tuple(short))

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

    def close(self) -> None:
        """Half a second of closing; the fingers go on pressing afterwards."""
        for finger in (LEFT, RIGHT):
            self._client.setJointMotorControl2(
                self.uid,
                finger,
                self._client.POSITION_CONTROL,
                targetPosition=0.0,
                force=self.gripper.closing_force,
            )
        self._step(CLOSING_STEPS)

    def opening(self) -> float:
        """The distance between the pads, metres."""
        return float(sum(state[0] for state in self._client.getJointStates(self.uid, (LEFT, RIGHT))))

    def touches(self) -> bool:
        """Whether the hand touched anything, the table included, when collisions were last computed."""
        return len(self._client.getContactPoints(self.uid)) > 0

    def touched(self) -> tuple[int, ...]:
        """The engine's numbers of what the hand touched, in the order of the contacts."""
        return tuple(int(point[2]) for point in self._client.getContactPoints(self.uid))

    def _target(self, position: Array, quaternion_xyzw: Array) -> None:
        """Where the arm pulls the body (its centre of mass) to."""
        self._client.changeConstraint(
            self._hold, position, quaternion_xyzw, maxForce=self.gripper.holding_force
        )

    def _step(self, count: int) -> None:
        for _ in range(count):
            self._client.stepSimulation()
