"""An arm, a gripper and a planner as what carries out grasps: `Manipulator`, whatever the drivers are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from neugrasp.detection.contract import Detection
from neugrasp.geometry.pose import Array
from neugrasp.grasp import Grasp
from neugrasp.robot.collision import Carried, CollisionChecker
from neugrasp.robot.errors import NoPlan
from neugrasp.robot.free_way import leg
from neugrasp.robot.held import held_box
from neugrasp.robot.interface import Arm, Gripper
from neugrasp.robot.motion import BACK, OUT_OF_SIGHT, TO_DROP, Motion, PickPlan
from neugrasp.robot.trajectory import Trajectory

PATIENCE = 3.0
"""A motion may take this many times as long as planned, and a second."""
GRIPPER_TIMEOUT_S = 5.0
CLEARANCE = 0.006
"""Metres kept from what was seen, but for the straight ways to a grasp and back."""
ARRIVED = 0.01
"""Radians by which the joints may be away from where a motion ended."""


@dataclass(frozen=True)
class Places:
    """Where the arm waits and where it lets go, joints (6,), and how hard it grips."""

    out_of_sight: Array
    drop: Array
    force: float
    """Newton."""


class ArmHand:
    """Plans every grasp before it begins, and knows the way back from wherever it was stopped."""

    def __init__(self, arm: Arm, gripper: Gripper, motion: Motion, places: Places, rest: Callable[[], None]):
        """`rest` returns when all that lies on the table rests."""
        self._arm, self._gripper, self._motion = arm, gripper, motion
        self._places, self._rest = places, rest
        self._checker: CollisionChecker | None = None
        self._seen: Detection | None = None
        self._plan: PickPlan | None = None
        self._asked: Grasp | None = None
        self._trail: list[Trajectory] = []

    @property
    def max_opening(self) -> float:
        """Largest distance between the pads, metres."""
        return self._gripper.max_opening

    def prepare(self, grasp: Grasp, detection: Detection) -> ArmHand:
        """Plans all motions of a grasp past the detected surface. As `Manipulator.prepare`."""
        if self._checker is None or self._seen is not detection:
            surface = None if detection.tsdf is None else detection.surface()
            self._checker, self._seen = self._motion.checker(surface, CLEARANCE), detection
        held = held_box(grasp, detection)
        self._plan = self._motion.pick(self._joints(), grasp, self._places.drop, self._checker, held)
        self._asked = grasp
        self._trail = []
        return self

    def open(self) -> None:
        """Opens as far as it goes."""
        self._gripper.move(self.max_opening, self._places.force, GRIPPER_TIMEOUT_S)

    def move_to_pose(self, pose: Array) -> bool:
        """To the pre-grasp on the way that was planned; False where something was touched."""
        plan = self._planned()
        if self._asked is None or not np.allclose(self._asked.pregrasp[:3, 3], pose[:3, 3], atol=1e-6):
            raise ValueError("the hand was prepared for another grasp")
        return not self._move(plan.way_in, until_contact=True)

    def move_straight(self, position: Array, stop_on_contact: bool) -> bool:
        """To the grasp, or back from it; whether a contact ended it."""
        plan = self._planned()
        if stop_on_contact:
            return self._move(plan.approach, until_contact=True)
        here = self._joints()
        if np.abs(here - plan.retreat.joints[0]).max() < ARRIVED:
            return self._move(plan.retreat, until_contact=False)
        try:
            back = self._motion.line(here, plan.grasp.retreat)
            up = self._motion.line(back[-1], self._motion.tcp(plan.retreat.joints[-1]))
        except NoPlan:
            return self._move(self._retraced(), until_contact=False)
        way = self._motion.timed([back, up], self._motion.approach_speed)
        return self._move(way.named(BACK), until_contact=False)

    def close(self) -> None:
        """Closes until something or the other finger resists, and goes on pressing."""
        self._gripper.move(0.0, self._places.force, GRIPPER_TIMEOUT_S)

    def opening(self) -> float:
        """The distance between the pads, metres."""
        return self._gripper.opening()

    def holds(self) -> bool:
        """Whether something is between the pads."""
        return self._gripper.holds()

    def place_in_bin(self) -> bool:
        """To where objects are dropped; whether something was still held there. Then out of sight."""
        plan = self._planned()
        here = self._joints()
        if np.abs(here - plan.way_out.joints[0]).max() < ARRIVED:
            self._move(plan.way_out, until_contact=False)
        else:
            self._go(self._places.drop, TO_DROP, plan.carried)
        held = self.holds()
        self.retract()
        return held

    def retract(self) -> None:
        """Lets go and goes out of sight."""
        self.open()
        self._go(self._places.out_of_sight, OUT_OF_SIGHT)
        self._rest()
        self._plan = None

    def _go(self, goal: Array, what: str, carried: Carried | None = None) -> None:
        """To joints (6,): on a new way, or back on the one that was come, and from its start."""
        here = self._joints()
        assert self._checker is not None
        try:
            way = self._motion.way(here, goal[None], self._checker, True, carried)
        except NoPlan:
            self._move(self._retraced(), until_contact=False)
            empty = self._motion.checker(None)
            way = self._motion.way(self._joints(), goal[None], empty, True, carried)
        self._move(way.named(what), until_contact=False)

    def _retraced(self) -> Trajectory:
        """Back on the motions since the grasp was prepared, to where they began."""
        here, legs = self._joints(), []
        for motion in reversed(self._trail):
            nearest = int(np.abs(motion.joints - here).max(axis=1).argmin())
            legs += [leg(here, motion.joints[nearest]), motion.joints[nearest::-1]]
            here = motion.joints[0]
        way = self._motion.timed([part for part in legs if len(part) > 1], self._motion.approach_speed)
        return way.named("back on the way it came")

    def _move(self, motion: Trajectory, until_contact: bool) -> bool:
        self._trail.append(motion)
        return self._arm.execute(motion, until_contact, PATIENCE * motion.duration + 1)

    def _joints(self) -> Array:
        return self._arm.state().joints

    def _planned(self) -> PickPlan:
        if self._plan is None:
            raise ValueError("no grasp was prepared")
        return self._plan
