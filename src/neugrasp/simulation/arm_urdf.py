"""An arm from a package of robot models, with a gripper of ours at its flange, as one URDF file.

Only what can touch something is kept: nothing of the arm is seen in depth images. `airo-models` is the only
package that is read; its arms stand on `base_link_inertia`, which is the controller's base frame, and end in
`tool0`, which is its flange.
"""

from __future__ import annotations

import copy
import re
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from scipy.spatial.transform import Rotation

from neugrasp.errors import InputError, require
from neugrasp.geometry.pose import Array

BASE, FLANGE = "base_link_inertia", "tool0"
ARMS = {"ur5e": "arms/ur5e/ur5e.urdf"}
"""Where the package keeps them."""
FOREIGN = re.compile(r'\sdrake:\w+="[^"]*"')
"""Attributes whose prefix the package does not declare."""


def write_arm(model: str, gripper_urdf: Path, flange_from_hand: Array, path: Path) -> Path:
    """Writes arm and gripper beside the gripper's meshes. Raises `InputError` where there is no such arm, and
    `MissingExtra` without the package."""
    if model not in ARMS:
        raise InputError(f"no model of a {model!r} for physics; the twin can be one of {', '.join(ARMS)}")
    require("airo_models", extra="robot")
    source = Path(str(resources.files("airo_models") / ARMS[model]))
    robot = ElementTree.fromstring(FOREIGN.sub("", source.read_text(encoding="utf-8")))
    for link in robot.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
        _unseen(link)
        if link.find("inertial") is None:
            _weightless(link)
        for mesh in link.iter("mesh"):
            mesh.set("filename", str(source.parent / mesh.attrib["filename"]))
    for part in ElementTree.parse(gripper_urdf).getroot():
        robot.append(copy.deepcopy(part))
    joint = SubElement(robot, "joint", name="mount", type="fixed")
    SubElement(joint, "parent", link=FLANGE)
    SubElement(joint, "child", link="palm")
    rpy = Rotation.from_matrix(flange_from_hand[:3, :3]).as_euler("xyz")
    SubElement(joint, "origin", xyz=_words(flange_from_hand[:3, 3]), rpy=_words(rpy))
    ElementTree.ElementTree(robot).write(path)
    return path


def _unseen(link: Element) -> None:
    """Without any visual shape the renderer would draw the collision shapes."""
    SubElement(SubElement(SubElement(link, "visual"), "geometry"), "box", size="1e-6 1e-6 1e-6")


def _weightless(link: Element) -> None:
    """Frames without a body: the engine would give each a kilogram."""
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "mass", value="1e-3")
    SubElement(inertial, "inertia", ixx="1e-6", ixy="0", ixz="0", iyy="1e-6", iyz="0", izz="1e-6")


def _words(numbers: Array) -> str:
    return " ".join(repr(float(x)) for x in np.asarray(numbers))
