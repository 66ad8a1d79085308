"""Grasps as ROS and MoveIt have them: dictionaries of the shape of geometry_msgs/PoseStamped.

The pose is that of a link: of the TCP (for the Panda `panda_hand_tcp`), of the hand's flange (`panda_hand`),
or of the Panda's last link (`panda_link8`, the usual tip of its MoveIt group). All have z along the approach;
the first two have y along the closing fingers, the last is turned by 45 degrees about z.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from neugrasp.data.fields import Fields
from neugrasp.data.strict_json import read_json
from neugrasp.detection.files import FARTHEST, HIGHEST, width_of
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, from_quaternion, inverse, rigid, to_quaternion
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper

FORMAT, VERSION = "neugrasp-ros-grasps", 1
Link = Literal["tcp", "hand", "panda_link8"]


@dataclass(frozen=True)
class Stamp:
    """What the poses are of, and in which frame."""

    frame_id: str = "world"
    """The name of the grasps' frame in the tree of transforms."""
    link: Link = "tcp"


def pose_stamped(pose: Array, frame_id: str) -> dict[str, Any]:
    """A 4x4 pose as the fields of a geometry_msgs/PoseStamped, time left out (ROS takes it as 0: latest)."""
    position = {axis: float(value) for axis, value in zip("xyz", pose[:3, 3], strict=True)}
    orientation = {axis: float(value) for axis, value in zip("xyzw", to_quaternion(pose), strict=True)}
    return {"header": {"frame_id": frame_id}, "pose": {"position": position, "orientation": orientation}}


def pose_of(message: dict[str, Any]) -> Array:
    """The 4x4 pose in the fields of a geometry_msgs/PoseStamped. Raises `InputError`."""
    return _pose_of(Fields("a PoseStamped", message))


def _pose_of(message: Fields) -> Array:
    position, orientation = (message.inside("pose").inside(key) for key in ("position", "orientation"))
    quaternion = [orientation.number(axis, -1.01, 1.01) for axis in "xyzw"]
    norm = float(np.linalg.norm(quaternion))
    if not abs(norm - 1) <= 0.01:
        raise message.refuse("pose.orientation", f"has length {norm:.3g}; it must be 1")
    return from_quaternion(quaternion, [position.number(axis, -FARTHEST, FARTHEST, "m") for axis in "xyz"])


def encode(grasps: Sequence[Grasp], gripper: Gripper, stamp: Stamp) -> list[dict[str, Any]]:
    """One dictionary for each grasp: id, grasp_pose and grasp_quality as in moveit_msgs/Grasp, the width, and
    where the hand stands before and after.

    Raises `InputError` where the gripper has no such link.
    """
    tcp_from_links = [inverse(link_from_tcp(gripper, stamp.link, grasp.width)) for grasp in grasps]
    return [
        {
            "id": f"grasp_{i}",
            "grasp_pose": pose_stamped(grasp.pose @ tcp_from_link, stamp.frame_id),
            "pre_grasp_pose": pose_stamped(grasp.pregrasp @ tcp_from_link, stamp.frame_id),
            "retreat_pose": pose_stamped(grasp.retreat @ tcp_from_link, stamp.frame_id),
            "grasp_quality": float(grasp.score),
            "width": float(grasp.width),
        }
        for i, (grasp, tcp_from_link) in enumerate(zip(grasps, tcp_from_links, strict=True))
    ]


def decode(messages: Sequence[dict[str, Any]], gripper: Gripper, stamp: Stamp) -> list[Grasp]:
    """The grasps of dictionaries made by `encode`. Raises `InputError` where they are something else."""
    fields = [Fields("grasps", message, f"grasps[{i}].") for i, message in enumerate(messages)]
    return _grasps(fields, gripper, stamp.link)


def _grasps(messages: Sequence[Fields], gripper: Gripper, link: Link) -> list[Grasp]:
    return [
        Grasp(
            _pose_of(message.inside("grasp_pose")) @ link_from_tcp(gripper, link, width_of(message)),
            width_of(message),
            message.number("grasp_quality", 0, HIGHEST),
        )
        for message in messages
    ]


def write(file: Path, grasps: Sequence[Grasp], gripper: Gripper, stamp: Stamp) -> None:
    """A JSON file, which is also YAML."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "link": stamp.link,
        "grasps": encode(grasps, gripper, stamp),
    }
    file.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def read(file: Path, gripper: Gripper) -> list[Grasp]:
    """The grasps of a file made by `write`. Raises `InputError` naming the file."""
    fields = Fields(str(file), read_json(file, "a list of grasps for ROS"))
    fields.expect(FORMAT, VERSION)
    link = cast(Link, fields.text("link", get_args(Link)))
    return _grasps(fields.each("grasps"), gripper, link)


def link_from_tcp(gripper: Gripper, link: Link, width: float) -> Array:
    """The TCP (4x4, metres) in a link's frame, with the pads `width` metres apart.

    Raises `InputError` where the gripper has no such link.
    """
    if link == "tcp":
        return np.eye(4)
    link_from_hand = np.eye(4)
    if link == "panda_link8":
        if gripper.name != "panda":
            raise InputError(f"--link panda_link8: is of the Panda; for {gripper.name} give hand or tcp")
        # franka_description's joint panda_hand_joint.
        link_from_hand[:3, :3] = Rotation.from_euler("z", -45, degrees=True).as_matrix()
    ahead = gripper.tcp_height - float(gripper.tip_setback(min(width, gripper.max_opening)))
    return link_from_hand @ rigid(translation=(0.0, 0.0, ahead))
