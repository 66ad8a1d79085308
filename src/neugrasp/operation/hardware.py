"""A real cell, opened: every driver connected, all of it behind the fence, and closed again in any case."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from neugrasp.errors import InputError
from neugrasp.robot.arm_hand import ArmHand, Places
from neugrasp.robot.cell_file import CellFile
from neugrasp.robot.errors import LimitExceeded
from neugrasp.robot.interface import Sensor
from neugrasp.robot.limits import Guarded
from neugrasp.robot.motion import Motion
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

    arm: Guarded
    manipulator: ArmHand
    camera: WristCamera


def empty_folder(cell: CellFile) -> Path:
    """Where the photos of a cell's empty table are kept: beside its file."""
    file = Path(cell.source)
    return file.with_name(f"{file.stem}_empty")


@contextmanager
def opened(cell: CellFile) -> Iterator[Hardware]:
    """The cell, its arm out of sight. Raises a `RobotError` that names what does not answer."""
    motion = planner_of(cell)
    tour = tour_of(cell, motion, cameras_of(cell))
    with ExitStack() as closing:
        sensor = closing.enter_context(_sensor(cell))
        gripper = closing.enter_context(Robotiq(cell.gripper.address, cell.gripper.gripper.max_opening))
        arm = closing.enter_context(Guarded(closing.enter_context(UrArm(cell.arm.address)), motion.fence))
        _go_home(arm, cell, motion)
        places = Places(cell.out_of_sight, cell.drop, cell.gripper.force)
        hand = ArmHand(arm, gripper, motion, places, rest=_nothing)
        yield Hardware(arm, hand, WristCamera(arm, sensor, tour, cell))


def _sensor(cell: CellFile) -> Sensor:
    part = cell.camera
    if part.driver != "realsense":
        raise InputError(f"{cell.source}: camera.driver {part.driver!r} is not part of this version")
    return RealSense(part.address, part.camera.width, part.camera.height, part.exposure_us)


def _go_home(arm: Guarded, cell: CellFile, motion: Motion) -> None:
    """Out of sight, from wherever it was left, where that is near and free."""
    here = arm.state().joints
    away = float(np.abs(here - cell.out_of_sight).max())
    if away > NEAR:
        raise LimitExceeded(
            f"the arm stands {np.rad2deg(away):.0f} degrees from out of sight, and nobody knows what is in "
            "between; drive it there with the pendant"
        )
    way = motion.way(here, cell.out_of_sight[None], motion.checker())
    arm.execute(way, until_contact=True, timeout_s=way.duration + GOING_HOME_S)


def _nothing() -> None:
    """A real table comes to rest by itself while the arm goes away."""
