"""Grippers and objects written as URDF files, for the loader of the physics engine."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, ElementTree, SubElement

import numpy as np
from scipy.spatial import ConvexHull

from neugrasp.geometry.pose import Array
from neugrasp.gripper import Gripper, Link

if TYPE_CHECKING:
    from neugrasp.simulation.objects import ObjectModel


def write_object(model: ObjectModel, path: Path) -> Path:
    """One body; the engine gives every part of its collision meshes a convex hull."""
    robot = Element("robot", name=model.name)
    link = SubElement(robot, "link", name="body")
    contact = SubElement(link, "contact")
    SubElement(contact, "lateral_friction", value=str(model.lateral_friction))
    _add_inertial(link, model.mass, np.array(model.centre_of_mass), model.inertial_rpy)
    _add_mesh(link, "visual", model.visual_mesh)
    if not model.engine_shapes:
        for mesh in model.collision_meshes:
            _add_mesh(link, "collision", mesh)
    for shape in model.engine_shapes:
        collision = _add_mesh(link, "collision", shape.mesh, scale=_words(shape.scale))
        SubElement(collision, "origin", xyz=_words(shape.xyz), rpy=_words(shape.rpy))
    ElementTree(robot).write(path)
    return path


def _add_mesh(link: Element, role: str, mesh: Path, **options: str) -> Element:
    element = SubElement(link, role)
    SubElement(SubElement(element, "geometry"), "mesh", {"filename": str(mesh.resolve()), **options})
    return element


def _words(numbers: Iterable[float]) -> str:
    return " ".join(map(str, numbers))


def write_gripper(gripper: Gripper, folder: Path) -> Path:
    """A palm with two sliding fingers, and one OBJ file per convex part."""
    robot = Element("robot", name=gripper.name)
    _add_link(robot, "palm", gripper.palm, folder, turned=False)
    for name, turned in (("left", False), ("right", True)):
        _add_link(robot, name, gripper.finger, folder, turned)
        joint = SubElement(robot, "joint", name=f"{name}_slide", type="prismatic")
        SubElement(joint, "parent", link="palm")
        SubElement(joint, "child", link=name)
        SubElement(joint, "origin", rpy="0 0 0", xyz=f"0 0 {gripper.finger_mount}")
        SubElement(joint, "axis", xyz="0 -1 0" if turned else "0 1 0")
        SubElement(
            joint,
            "limit",
            lower="0",
            upper=str(gripper.max_opening / 2),
            effort=str(gripper.closing_force),
            velocity=str(gripper.closing_speed),
        )
    path = folder / "gripper.urdf"
    ElementTree(robot).write(path)
    return path


def _add_link(robot: Element, name: str, link: Link, folder: Path, turned: bool) -> None:
    element = SubElement(robot, "link", name=name)
    turn = np.array([-1, -1, 1]) if turned else np.ones(3)
    _add_inertial(element, link.mass, link.centre_of_mass * turn)
    # Without any visual shape the renderer would draw the collision shapes.
    SubElement(SubElement(SubElement(element, "visual"), "geometry"), "box", size="1e-6 1e-6 1e-6")
    for number, hull in enumerate(link.hulls):
        mesh = folder / f"{name}_{number}.obj"
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in hull.tolist()]
        lines += ["f {} {} {}".format(*(face + 1)) for face in ConvexHull(hull).simplices]
        mesh.write_text("\n".join(lines) + "\n", encoding="utf-8")
        collision = SubElement(element, "collision")
        SubElement(collision, "origin", rpy=f"0 0 {np.pi if turned else 0.0!r}", xyz="0 0 0")
        SubElement(SubElement(collision, "geometry"), "mesh", filename=mesh.name)


def _add_inertial(
    link: Element, mass: float, centre_of_mass: Array, rpy: tuple[float, ...] = (0, 0, 0)
) -> None:
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "origin", rpy=_words(rpy), xyz=_words(centre_of_mass.tolist()))
    SubElement(inertial, "mass", value=str(mass))
    # The format wants an inertia; the engine ignores it and computes one from the shapes.
    SubElement(inertial, "inertia", ixx="1", ixy="0", ixz="0", iyy="1", iyz="0", izz="1")
