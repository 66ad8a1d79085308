"""An arm with a gripper in a physics world: joints that follow targets, fingers as in `hand`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from neugrasp.geometry.pose import Array, from_quaternion, inverse
from neugrasp.gripper import Gripper
from neugrasp.simulation.arm_urdf import BASE, FLANGE

STIFFNESS, DAMPING = 0.9, 1.0
"""Gains of the joints, in the engine's terms."""
TORQUES = (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)
"""Newton metres that the joints can give (UR5e)."""


class JointedArm:
    """Arm and gripper, one body in the world behind `client`."""

    def __init__(self, client: Any, gripper: Gripper, urdf: Path, world_from_base: Array):
        self.gripper = gripper
        self._client = client
        self.uid: int = client.loadURDF(str(urdf), useFixedBase=True)
        count = client.getNumJoints(self.uid)
        facts = [client.getJointInfo(self.uid, i) for i in range(count)]
        number = {fact[12].decode(): fact[0] for fact in facts}
        self._joints = tuple(fact[0] for fact in facts if fact[2] == client.JOINT_REVOLUTE)
        self._flange: int = number[FLANGE]
        self._fingers = (number["left"], number["right"])
        self._hand_links = {number["palm"], *self._fingers}
        self._stand(world_from_base, number[BASE])
        self._prepare_fingers()
        self.time_step = float(client.getPhysicsEngineParameters()["fixedTimeStep"])

    def _stand(self, world_from_base: Array, base: int) -> None:
        """Puts the arm so that its link `base` is where it should be."""
        position, quaternion = self._client.getLinkState(self.uid, base)[4:6]
        inside = from_quaternion(quaternion, position)
        root = from_quaternion(*reversed(self._client.getBasePositionAndOrientation(self.uid)))
        pose = world_from_base @ inverse(inside) @ root
        quaternion = Rotation.from_matrix(pose[:3, :3]).as_quat()
        self._client.resetBasePositionAndOrientation(self.uid, pose[:3, 3], quaternion)

    def _prepare_fingers(self) -> None:
        client, (left, right), pads = self._client, self._fingers, self.gripper.pads
        gear = client.createConstraint(
            self.uid, left, self.uid, right, client.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0]
        )
        client.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=self.gripper.centring_force)
        for finger in self._fingers:
            client.changeDynamics(
                self.uid,
                finger,
                lateralFriction=pads.lateral_friction,
                spinningFriction=pads.spinning_friction,
                contactStiffness=pads.stiffness,
                contactDamping=pads.damping,
                frictionAnchor=1,
            )
        self.set_fingers(self.gripper.max_opening, self.gripper.closing_force)

    def put(self, joints: Array) -> None:
        """Teleports the arm, at rest, its fingers open."""
        for joint, angle in zip(self._joints, joints, strict=True):
            self._client.resetJointState(self.uid, joint, float(angle), 0.0)
        for finger in self._fingers:
            self._client.resetJointState(self.uid, finger, self.gripper.max_opening / 2, 0.0)
        self.aim(joints)
        self.set_fingers(self.gripper.max_opening, self.gripper.closing_force)

    def joints(self) -> Array:
        """(6,) radians."""
        return np.array([state[0] for state in self._client.getJointStates(self.uid, self._joints)])

    def speeds(self) -> Array:
        """(6,) rad/s."""
        return np.array([state[1] for state in self._client.getJointStates(self.uid, self._joints)])

    def flange(self) -> Array:
        """`world_from_flange`."""
        state = self._client.getLinkState(self.uid, self._flange, computeForwardKinematics=True)
        return from_quaternion(state[5], state[4])

    def aim(self, joints: Array, speeds: Array | None = None) -> None:
        """Where the joints are driven to from now on."""
        client = self._client
        client.setJointMotorControlArray(
            self.uid,
            self._joints,
            client.POSITION_CONTROL,
            targetPositions=joints.tolist(),
            targetVelocities=(np.zeros(len(self._joints)) if speeds is None else speeds).tolist(),
            forces=TORQUES,
            positionGains=[STIFFNESS] * len(self._joints),
            velocityGains=[DAMPING] * len(self._joints),
        )

    def set_fingers(self, opening: float, force: float) -> None:
        """Where the fingers are driven to from now on, metres, and with how many newton each."""
        client = self._client
        for finger in self._fingers:
            client.setJointMotorControl2(
                self.uid,
                finger,
                client.POSITION_CONTROL,
                targetPosition=opening / 2,
                force=force,
                maxVelocity=self.gripper.closing_speed,
            )

    def opening(self) -> float:
        """The distance between the pads, metres."""
        return float(sum(state[0] for state in self._client.getJointStates(self.uid, self._fingers)))

    def follow(self, targets: Iterable[Array], until: Callable[[], bool]) -> bool:
        """One physics step for each target (6,); whether `until` ended it. The arm stays where it then is."""
        before = self.joints()
        for target in targets:
            self.aim(target, (target - before) / self.time_step)
            before = target
            self._client.stepSimulation()
            if until():
                self.aim(self.joints())
                return True
        return False

    def wait(self, steps: int) -> None:
        """Lets time pass."""
        for _ in range(steps):
            self._client.stepSimulation()

    def touches(self) -> bool:
        """Whether anything of arm and hand touched anything else in the last step."""
        return len(self.touched()) > 0

    def touched(self) -> tuple[int, ...]:
        """The engine's numbers of what arm and hand touched; the foot of the arm stands on the table."""
        points = self._client.getContactPoints(self.uid)
        return tuple(int(p[2]) for p in points if int(p[2]) != self.uid and int(p[3]) >= self._joints[1])

    def held(self) -> tuple[int, ...]:
        """The engine's numbers of what the hand touched."""
        points = self._client.getContactPoints(self.uid)
        return tuple(int(p[2]) for p in points if int(p[2]) != self.uid and int(p[3]) in self._hand_links)
