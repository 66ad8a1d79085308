"""Forward and inverse kinematics of UR arms, against each other and against a package's description."""

from __future__ import annotations

import re
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, rigid
from neugrasp.robot.arm_model import ARMS, ArmModel, arm_model
from neugrasp.robot.inverse import in_range, joints_of

needs_models = pytest.mark.skipif(find_spec("airo_models") is None, reason="needs neugrasp[robot]")


@pytest.mark.slow
@pytest.mark.parametrize("model", ARMS.values(), ids=ARMS)
def test_every_solution_reaches_the_pose_and_the_joints_it_was_made_of_are_among_them(model: ArmModel):
    """10,000 poses over both arms."""
    rng = np.random.default_rng(0)
    every = rng.uniform(-np.pi, np.pi, (5000, 6))
    poses = model.flange(every)
    for joints, pose in zip(every, poses, strict=True):
        found = joints_of(model, pose)
        assert 1 <= len(found) <= 8
        assert np.abs(model.flange(found) - pose).max() < 1e-9
        apart = np.abs(np.angle(np.exp(1j * (found - joints)))).max(axis=1)
        assert apart.min() < 1e-6


def test_solutions_differ_from_one_another():
    model = arm_model("ur5e")
    found = joints_of(model, model.flange(np.array([0.3, -1.2, 1.4, -0.8, -1.1, 0.5])))
    apart = np.abs(found[:, None] - found[None]).max(axis=-1)
    assert len(found) == 8
    assert (apart + np.eye(8) > 1e-3).all()


def test_beyond_its_reach_there_is_no_solution():
    assert len(joints_of(arm_model("ur5e"), rigid(translation=(1.2, 0, 0.3)))) == 0
    assert len(joints_of(arm_model("ur5e"), rigid(translation=(0.0, 0.0, 0.3)))) == 0


def test_at_the_singular_wrist_the_last_joint_is_the_one_that_was_given():
    model = arm_model("ur5e")
    joints = np.array([0.3, -1.2, 1.4, -0.8, 0.0, 0.5])
    found = joints_of(model, model.flange(joints), wrist_3=0.5)
    assert np.abs(model.flange(found) - model.flange(joints)).max() < 1e-6
    assert np.abs(found - joints).max(axis=1).min() < 1e-6


def test_joints_are_turned_to_the_side_on_which_the_arm_is_and_stay_in_their_range():
    model = arm_model("ur5e")
    near = np.array([6.0, -1.0, 1.0, 0.0, 5.0, -6.0])
    found = in_range(model, joints_of(model, model.flange(near)), near)
    assert np.abs(found - near).max(axis=1).min() < 1e-6
    assert (np.abs(found) <= np.array(model.high) + 1e-12).all()


def test_an_unknown_arm_is_refused_with_those_that_are_known():
    with pytest.raises(InputError, match="unknown arm 'kr3'; choose one of ur5e, ur5"):
        arm_model("kr3")


def transform(origin: ElementTree.Element | None) -> Array:
    if origin is None:
        return np.eye(4)
    words = {key: [float(x) for x in origin.get(key, "0 0 0").split()] for key in ("xyz", "rpy")}
    return rigid(Rotation.from_euler("xyz", words["rpy"]).as_matrix(), words["xyz"])


def described() -> tuple[ElementTree.Element, Path]:
    """The package's UR5e."""
    file = Path(str(resources.files("airo_models") / "arms/ur5e/ur5e.urdf"))
    return ElementTree.fromstring(re.sub(r'drake:\w+="[^"]*"', "", file.read_text())), file.parent


def links_at(robot: ElementTree.Element, joints: Array) -> dict[str, Array]:
    """`base_from_link` of every link with the joints at (6,)."""
    frames, angles = {"base_link_inertia": np.eye(4)}, iter(joints)
    for joint in robot.findall("joint"):
        parent, child = (joint.find(end).get("link") for end in ("parent", "child"))  # type: ignore[union-attr]
        if parent not in frames:
            continue
        turn = np.eye(4)
        if joint.get("type") == "revolute":
            turn = rigid(Rotation.from_euler("z", next(angles)).as_matrix())
        frames[child] = frames[parent] @ transform(joint.find("origin")) @ turn
    return frames


@needs_models
def test_the_flange_is_where_a_package_of_robot_models_has_it():
    robot, _ = described()
    model = arm_model("ur5e")
    for joints in np.random.default_rng(1).uniform(-3, 3, (100, 6)):
        assert np.abs(links_at(robot, joints)["tool0"] - model.flange(joints)).max() < 1e-8


@needs_models
def test_the_capsules_hold_the_meshes_of_the_package():
    """All corners of all collision meshes, to a millimetre."""
    robot, folder = described()
    model = arm_model("ur5e")
    frames, links = model.frames(np.zeros(6)), links_at(robot, np.zeros(6))
    names = ("base_link_inertia", "shoulder_link", "upper_arm_link", "forearm_link")
    names += ("wrist_1_link", "wrist_2_link", "wrist_3_link")
    for number, name in enumerate(names):
        element = next(link for link in robot.findall("link") if link.get("name") == name)
        for shape in element.findall("collision"):
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            corners = trimesh.load(folder / mesh.attrib["filename"], force="mesh").vertices
            pose = np.linalg.inv(frames[number]) @ links[name] @ transform(shape.find("origin"))
            outside = distance_to_capsules(model, number, trimesh.transform_points(corners, pose))
            assert outside.max() < 1e-3, name


def distance_to_capsules(model: ArmModel, frame: int, points: Array) -> Array:
    """How far points (n, 3) lie outside all capsules of a link."""
    distances = []
    for capsule in (c for c in model.capsules if c.frame == frame):
        start, along = np.array(capsule.start), np.subtract(capsule.end, capsule.start)
        part = np.clip((points - start) @ along / max(along @ along, 1e-12), 0, 1)
        distances.append(np.linalg.norm(points - start - part[:, None] * along, axis=1) - capsule.radius)
    return np.min(distances, axis=0)
