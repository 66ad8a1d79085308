"""A real cell, opened: every driver connected, all of it behind the fence, and closed again in any case."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from neugrasp.robot.arm_hand import ArmHand, Places
from neugrasp.robot.attended import Attendant, AttendedArm, AttendedGripper, AttendedManipulator
from neugrasp.robot.cell_file import CellFile
from neugrasp.robot.errors import LimitExceeded
from neugrasp.robot.interface import Arm, Gripper, Manipulator, Sensor
from neugrasp.robot.limits import Guarded
from neugrasp.robot.motion import OUT_OF_SIGHT, Motion
from neugrasp.robot.opencv_camera import OpenCvCamera
from neugrasp.robot.realsense import RealSense
from neugrasp.robot.robotiq import Robotiq
from neugrasp.robot.ur_arm import UrArm
from neugrasp.robot.workcell import cameras_of, planner_of, tour_of
from neugrasp.robot.wrist_camera import WristCamera

GOING_HOME_S = 60.0
NEAR = 0.5
"""Radians from out of sight within which the arm goes there by itself when a run begins."""


@dataclass(frozen=True)
class Hardware:
    """What a loop needs of it."""

    arm: Arm
    manipulator: Manipulator
    camera: WristCamera
    gripper: Gripper
    motion: Motion
    led: Guarded
    """The same arm, for a person who leads it."""


def empty_folder(cell: CellFile) -> Path:
    """Where the photos of a cell's empty table are kept: beside its file."""
    file = Path(cell.source)
    return file.with_name(f"{file.stem}_empty")


@contextmanager
def opened(cell: CellFile, attendants: Sequence[Attendant] = ()) -> Iterator[Hardware]:
    """The cell, its arm out of sight. Attendants are told before anything moves.

    Raises a `RobotError` that names what does not answer."""
    motion = planner_of(cell)
    tour = tour_of(cell, motion, cameras_of(cell))
    with ExitStack() as closing:
        sensor = closing.enter_context(_sensor(cell))
        gripper = closing.enter_context(Robotiq(cell.gripper.address, cell.gripper.gripper))
        guarded = closing.enter_context(
            Guarded(closing.enter_context(UrArm(cell.arm.address, cell.limits.force)), motion.fence)
        )
        arm = AttendedArm(guarded, *attendants)
        go_home(arm, cell, motion)
        places = Places(cell.out_of_sight, cell.drop, cell.gripper.force)
        fingers = AttendedGripper(gripper, *attendants)
        hand = ArmHand(arm, fingers, motion, places, rest=_nothing)
        manipulator = AttendedManipulator(hand, *attendants)
        camera = WristCamera(arm, sensor, tour, cell)
        yield Hardware(arm, manipulator, camera, fingers, motion, guarded)


def _sensor(cell: CellFile) -> Sensor:
    part = cell.camera
    driver = RealSense if part.driver == "realsense" else OpenCvCamera
    return driver(part.address, part.lens, part.exposure_us)


def go_home(arm: Arm, cell: CellFile, motion: Motion) -> None:
    """Out of sight, from wherever it was left, where that is near and free."""
    here = arm.state().joints
    away = float(np.abs(here - cell.out_of_sight).max())
    if away > NEAR:
        raise LimitExceeded(
            f"the arm stands {np.rad2deg(away):.0f} degrees from out of sight, and nobody knows what is in "
            "between; drive it there with the pendant"
        )
    way = motion.way(here, cell.out_of_sight[None], motion.checker())
    arm.execute(way.named(OUT_OF_SIGHT), until_contact=True, timeout_s=way.duration + GOING_HOME_S)


def _nothing() -> None:
    """A real table comes to rest by itself while the arm goes away."""
