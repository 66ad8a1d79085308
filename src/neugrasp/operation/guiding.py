"""A person leads the arm to grasps: the gripper closes, the arm lifts a little and puts it back.

What is stored is where the hand stood when it closed, how far it was open with the object in it, and whether
the object came along.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from neugrasp.data.captures import write_labels
from neugrasp.data.scene_folder import write_scene
from neugrasp.execution import MIN_OPENING
from neugrasp.geometry.pose import Array, rigid
from neugrasp.grasp import Grasp
from neugrasp.observation import Views
from neugrasp.operation.hardware import Hardware, go_home
from neugrasp.operation.person import Person
from neugrasp.operation.tried import Tried, labels_of
from neugrasp.progress import reached
from neugrasp.robot.cell_file import CellFile
from neugrasp.robot.errors import NoPlan, Refused
from neugrasp.robot.interface import Camera

LIFT = 0.05
"""Metres that an object must come along."""
MOVING_S, GRIPPER_S = 10.0, 5.0
"""Seconds beyond the length of a motion, and for the gripper."""
DONE = ("d", "done")


@dataclass(frozen=True)
class Guide:
    """What it takes to be led."""

    cell: CellFile
    hardware: Hardware
    camera: Camera[Views]
    person: Person


def lead_through(folders: Mapping[int, Path], guide: Guide) -> None:
    """One scene after the other into its folder; each grasp is written when it was tried.

    Raises `Stopped` where the person ends it, and a `RobotError` where the arm has a fault.
    """
    for done, (number, folder) in enumerate(folders.items(), 1):
        guide.person.asked(f"scene {number}: lay objects on the table, stand back, then Enter; q: end here")
        views = guide.camera.capture()
        write_scene(folder, views)
        tried: list[Tried] = []
        while (one := _led(guide)) is not None:
            tried.append(one)
            write_labels(folder, labels_of(tried, views.workspace, guide.cell.gripper.gripper))
            said = "held" if one.success else "not held"
            guide.person.told(f"grasp {len(tried)}: {said}, {1000 * one.opening:.0f} mm between the pads")
        guide.person.told("the arm goes out of sight")
        go_home(guide.hardware.arm, guide.cell, guide.hardware.motion)
        reached("scenes", done, len(folders))


def _led(guide: Guide) -> Tried | None:
    """The grasp to which the arm is led, and what comes of it; None where the person has enough."""
    arm, gripper, motion = guide.hardware.led, guide.hardware.gripper, guide.hardware.motion
    force = guide.cell.gripper.force
    gripper.move(gripper.max_opening, force, GRIPPER_S)
    while True:
        with arm.led_by_hand():
            answer = guide.person.asked(
                "lead the hand to a grasp, then Enter; lead it out of sight, then d: done with this scene"
            )
        if answer in DONE:
            return None
        joints = arm.state().joints
        pose: Array = motion.tcp(joints)
        try:
            motion.fence.check_pose(pose)
            lifting = motion.line(joints, rigid(translation=LIFT * _up(guide)) @ pose)
        except (NoPlan, Refused) as reason:
            guide.person.told(f"not from here: {reason}")
            continue
        return _tried(guide, pose, lifting)


def _tried(guide: Guide, pose: Array, lifting: Array) -> Tried:
    """Closes at a pose, lifts along joints (m, 6), looks what is held, and puts it back."""
    gripper = guide.hardware.gripper
    least = MIN_OPENING["paper"] * gripper.max_opening
    x, y, z = _up(guide).tolist()
    gripper.move(0.0, guide.cell.gripper.force, GRIPPER_S)
    opening = gripper.opening()
    held = opening > least
    if held:
        _follow(guide, lifting)
        opening = gripper.opening()
        held = gripper.holds() and opening > least
        _follow(guide, lifting[::-1])
    gripper.move(gripper.max_opening, guide.cell.gripper.force, GRIPPER_S)
    stands = Grasp(pose, opening, up=(x, y, z))
    return Tried(guide.hardware.motion.tool.reached(stands), held, opening)


def _follow(guide: Guide, joints: Array) -> None:
    motion = guide.hardware.motion.timed([joints], guide.hardware.motion.approach_speed)
    guide.hardware.arm.execute(motion, until_contact=False, timeout_s=motion.duration + MOVING_S)


def _up(guide: Guide) -> Array:
    up: Array = guide.cell.workspace.world_from_workspace[:3, 2]
    return up
