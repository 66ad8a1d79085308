"""A round that only takes place on paper: what arm and gripper would be told, with nothing sent to either.

Fence, planner and the order of things are those of a real round; arm and gripper only remember where they
would be.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from neugrasp.detection.contract import Detection
from neugrasp.geometry.pose import Array
from neugrasp.grasp import Grasp
from neugrasp.robot.arm_hand import ArmHand, Places
from neugrasp.robot.attended import AttendedArm, AttendedGripper, Step
from neugrasp.robot.cell_file import CellFile
from neugrasp.robot.interface import Arm, ArmState, StopsOnLeaving
from neugrasp.robot.limits import Guarded
from neugrasp.robot.motion import Motion
from neugrasp.robot.pick import pick
from neugrasp.robot.ranking import Next, Skipped, first_possible
from neugrasp.robot.tour import Tour
from neugrasp.robot.trajectory import Trajectory

THIN = 0.001
"""Metres that a gripper on paper holds at least."""


@dataclass(frozen=True)
class Rehearsal:
    """What a round would do."""

    steps: tuple[Step, ...]
    """In their order, from out of sight and back to it."""
    detection: Detection
    grasp: Grasp | None
    """The one that would be carried out; None where none can be."""
    skipped: tuple[Skipped, ...]
    """Those passed over before it."""


@dataclass
class _Notes:
    """An attendant who writes everything down."""

    steps: list[Step] = field(default_factory=list)

    def meet(self, arm: Arm) -> None:
        """Nobody needs to be stopped."""

    def before(self, step: Step) -> None:
        self.steps.append(step)


@dataclass
class _PaperArm(StopsOnLeaving):
    """Is at once where it is sent."""

    joints: Array

    def state(self) -> ArmState:
        return ArmState(self.joints, np.zeros_like(self.joints), 0.0)

    def execute(self, motion: Trajectory, until_contact: bool, timeout_s: float) -> bool:
        self.joints = motion.joints[-1]
        return False

    def stop(self) -> None:
        """It stands still."""


@dataclass
class _PaperGripper:
    """Holds what the detector expects between the pads."""

    max_opening: float
    thing: float = 0.0
    at: float = 0.0

    def move(self, opening: float, force: float, timeout_s: float) -> float:
        self.at = max(opening, self.thing)
        return self.at

    def opening(self) -> float:
        return self.at

    def holds(self) -> bool:
        return True


def rehearsed(cell: CellFile, motion: Motion, tour: Tour, detection: Detection, choose: Next) -> Rehearsal:
    """A look through all views and the first of the detected grasps that can be carried out.

    Raises a `Refused` where the layer below the network would not let a motion pass.
    """
    notes = _Notes()
    arm = AttendedArm(Guarded(_PaperArm(cell.out_of_sight), motion.fence), notes)
    for stop in tour.stops:
        arm.execute(stop.way, False, stop.way.duration)
    arm.execute(tour.home, False, tour.home.duration)
    paper = _PaperGripper(cell.gripper.gripper.max_opening)
    places = Places(cell.out_of_sight, cell.drop, cell.gripper.force)
    hand = ArmHand(arm, AttendedGripper(paper, notes), motion, places, rest=lambda: None)
    chosen = first_possible(hand, detection, choose)
    if chosen.index is None or chosen.hand is None:
        return Rehearsal(tuple(notes.steps), detection, None, chosen.skipped)
    grasp = detection.grasps[chosen.index]
    paper.thing = float(np.clip(grasp.width, THIN, paper.max_opening))
    pick(hand, chosen.hand, grasp, THIN / 2, detection.workspace.world_from_workspace[:3, 2])
    return Rehearsal(tuple(notes.steps), detection, grasp, chosen.skipped)
