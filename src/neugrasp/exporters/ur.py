"""Grasps as robots of Universal Robots have them: poses p[x, y, z, rx, ry, rz], metres and a rotation vector.

The rotation vector lies along the axis and is as long as the angle, in radians; it is no roll, pitch and yaw.
The frame is that of the grasps: the robot's base, where the world of the scene is that. The pose is
that of a link: the TCP, where the robot's own TCP is set to it, or the hand's flange.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np

from neugrasp.data.fields import Fields
from neugrasp.data.strict_json import read_json
from neugrasp.detection.files import FARTHEST, HIGHEST, width_of
from neugrasp.exporters.ros import link_from_tcp
from neugrasp.geometry.pose import Array, from_rotation_vector, inverse, to_rotation_vector
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper

FORMAT, VERSION = "neugrasp-ur-grasps", 1
Link = Literal["tcp", "hand"]
WHOLE_TURN = 2 * np.pi + 1e-3
"""Radians; a longer rotation vector is one in degrees."""


def vector_of(pose: Array) -> list[float]:
    """[x, y, z, rx, ry, rz] of a 4x4 pose."""
    return [*pose[:3, 3].tolist(), *to_rotation_vector(pose).tolist()]


def pose_of(vector: Sequence[float] | Array) -> Array:
    """The 4x4 pose of [x, y, z, rx, ry, rz]."""
    return from_rotation_vector(vector[3:6], vector[:3])


def encode(grasps: Sequence[Grasp], gripper: Gripper, link: Link) -> list[dict[str, Any]]:
    """For each grasp the poses before, at and after it, its width in metres and its score."""
    tcp_from_links = [inverse(link_from_tcp(gripper, link, grasp.width)) for grasp in grasps]
    return [
        {
            "pregrasp": vector_of(grasp.pregrasp @ tcp_from_link),
            "grasp": vector_of(grasp.pose @ tcp_from_link),
            "retreat": vector_of(grasp.retreat @ tcp_from_link),
            "width": float(grasp.width),
            "score": float(grasp.score),
        }
        for grasp, tcp_from_link in zip(grasps, tcp_from_links, strict=True)
    ]


def write(file: Path, grasps: Sequence[Grasp], gripper: Gripper, link: Link) -> None:
    """A JSON file."""
    content = {"format": FORMAT, "version": VERSION, "link": link, "grasps": encode(grasps, gripper, link)}
    file.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def read(file: Path, gripper: Gripper) -> list[Grasp]:
    """The grasps of a file made by `write`; z is taken for up. Raises `InputError` naming the file."""
    fields = Fields(str(file), read_json(file, "a list of grasps for UR"))
    fields.expect(FORMAT, VERSION)
    link = cast(Link, fields.text("link", get_args(Link)))
    return [_grasp(entry, link_from_tcp(gripper, link, width_of(entry))) for entry in fields.each("grasps")]


def _grasp(fields: Fields, shift: Array) -> Grasp:
    vector = fields.numbers("grasp", 6, FARTHEST, "[x, y, z, rx, ry, rz] in metres and radians")
    if np.linalg.norm(vector[3:]) > WHOLE_TURN:
        raise fields.refuse("grasp", "has a rotation vector longer than a whole turn; radians are wanted")
    return Grasp(pose_of(vector) @ shift, width_of(fields), fields.number("score", 0, HIGHEST))
