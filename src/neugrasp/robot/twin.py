"""A cell in physics with an arm that can fail to reach: drivers of arm and gripper behind the protocols.

The user's world is the workspace frame here, as in `robot.simulated`. Time is that of the simulation.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence

import numpy as np

from neugrasp.data.world import Scene
from neugrasp.geometry.pose import Array
from neugrasp.robot.arm_hand import ArmHand, Places
from neugrasp.robot.attended import Attendant, AttendedArm, AttendedGripper, AttendedManipulator
from neugrasp.robot.cell_file import CellFile
from neugrasp.robot.errors import MotionTimeout, Stopped
from neugrasp.robot.interface import ArmState, StopsOnLeaving
from neugrasp.robot.limits import Guarded
from neugrasp.robot.motion import Motion
from neugrasp.robot.simulated import SimulatedRobot
from neugrasp.robot.trajectory import Trajectory
from neugrasp.simulation.arm import JointedArm
from neugrasp.simulation.physics import World

COMING_TO_REST = 24
"""Physics steps after the last target of a motion."""
CLOSING_S, OPENING_S = 0.5, 0.7
"""Seconds that the fingers are given: as long as the floating hand has to close."""


class TwinArm(StopsOnLeaving):
    """Joints in physics that follow a motion, one target for each of the engine's steps."""

    def __init__(self, body: JointedArm):
        self._body = body
        self._stopped = threading.Event()
        self._seconds = 0.0

    def state(self) -> ArmState:
        """Where the joints are."""
        return ArmState(self._body.joints(), self._body.speeds(), self._seconds)

    def execute(self, motion: Trajectory, until_contact: bool, timeout_s: float) -> bool:
        """As `Arm.execute`."""
        if motion.duration > timeout_s:
            raise MotionTimeout(f"the motion takes {motion.duration:.1f} s; {timeout_s:.1f} s allowed")
        touched = self._body.touches if until_contact else _never
        contact = self._body.follow(self._targets(motion), touched)
        if self._stopped.is_set():
            raise Stopped("the arm was stopped on its way")
        if not contact:
            self._body.wait(COMING_TO_REST)
        return contact

    def _targets(self, motion: Trajectory) -> Iterator[Array]:
        step = self._body.time_step
        for number in range(1, int(np.ceil(motion.duration / step)) + 1):
            if self._stopped.is_set():
                return
            self._seconds += step
            yield motion.at(number * step)

    def stop(self) -> None:
        """Ends a motion at the engine's next step."""
        self._stopped.set()


def _never() -> bool:
    return False


class TwinGripper:
    """Fingers in physics."""

    def __init__(self, body: JointedArm, world: World):
        self._body, self._world = body, world

    @property
    def max_opening(self) -> float:
        """Largest distance between the pads, metres."""
        return self._body.gripper.max_opening

    def move(self, opening: float, force: float, timeout_s: float) -> float:
        """As `Gripper.move`."""
        is_closing = opening < self._body.opening()
        self._body.set_fingers(opening, force)
        self._body.wait(round(min(timeout_s, CLOSING_S if is_closing else OPENING_S) / self._body.time_step))
        return self._body.opening()

    def opening(self) -> float:
        """The distance between the pads, metres."""
        return self._body.opening()

    def holds(self) -> bool:
        """Whether an object touches the hand."""
        return self._world.held() is not None


class TwinRobot:
    """The cell: arm, gripper and table in one world."""

    def __init__(
        self, world: World, scene: Scene, cell: CellFile, motion: Motion, attendants: Sequence[Attendant] = ()
    ):
        """Lays `scene` into `world` and brings the arm in, out of sight. `cell` and `motion` are in the
        frame of the workspace (`workcell.moved_to`)."""
        self.table = SimulatedRobot(world, scene)
        body = world.mount(cell.arm.model.name, cell.arm.world_from_base, cell.gripper.flange_from_hand)
        body.put(cell.out_of_sight)
        self.arm = AttendedArm(Guarded(TwinArm(body), motion.fence), *attendants)
        gripper = AttendedGripper(TwinGripper(body, world), *attendants)
        places = Places(cell.out_of_sight, cell.drop, cell.gripper.force)
        hand = ArmHand(self.arm, gripper, motion, places, self.table.retract)
        self.manipulator = AttendedManipulator(hand, *attendants)
