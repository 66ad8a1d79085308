"""Grasps as ROS and MoveIt have them: dictionaries of the shape of geometry_msgs/PoseStamped.

The pose is that of a link of the gripper: of the TCP (for the Panda `panda_hand_tcp`), or of the hand's
flange (`panda_hand`, the usual end effector link). Both have z along the approach and y along the closing
fingers.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from neugrasp.errors import InputError
from neugrasp.export import naming_the_list
from neugrasp.geometry.pose import Array, from_quaternion, to_quaternion
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper

FORMAT, VERSION = "neugrasp-ros-grasps", 1
Link = Literal["tcp", "hand"]


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
    """The 4x4 pose in the fields of a geometry_msgs/PoseStamped."""
    pose = message["pose"]
    quaternion = [float(pose["orientation"][axis]) for axis in "xyzw"]
    return from_quaternion(quaternion, [float(pose["position"][axis]) for axis in "xyz"])


def encode(grasps: Sequence[Grasp], gripper: Gripper, stamp: Stamp) -> list[dict[str, Any]]:
    """One dictionary for each grasp: id, grasp_pose and grasp_quality as in moveit_msgs/Grasp, and width."""
    return [
        {
            "id": f"grasp_{i}",
            "grasp_pose": pose_stamped(grasp.advanced(-_tcp(gripper, stamp.link)).pose, stamp.frame_id),
            "grasp_quality": float(grasp.score),
            "width": float(grasp.width),
        }
        for i, grasp in enumerate(grasps)
    ]


def decode(messages: Sequence[dict[str, Any]], gripper: Gripper, stamp: Stamp) -> list[Grasp]:
    """The grasps of dictionaries made by `encode`."""
    return [
        Grasp(
            pose_of(message["grasp_pose"]), float(message["width"]), float(message["grasp_quality"])
        ).advanced(_tcp(gripper, stamp.link))
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
    with naming_the_list(file):
        data = json.loads(file.read_text(encoding="utf-8"))
        if data["format"] != FORMAT or data["version"] != VERSION or data["link"] not in ("tcp", "hand"):
            raise InputError(f"{file}: not a {FORMAT} file of version {VERSION}")
        return decode(data["grasps"], gripper, Stamp(link=data["link"]))


def _tcp(gripper: Gripper, link: Link) -> float:
    """Metres from the link's origin to the TCP."""
    return gripper.tcp_height if link == "hand" else 0.0
