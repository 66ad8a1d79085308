"""Fingertips that swing: the gripper's file against the linkage of a package's description."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from neugrasp.detection.collision_filter import CollisionFilter
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.robot.tool import Tool
from robot_cells import down_at

HAND = Gripper.load("robotiq_2f85")
needs_models = pytest.mark.skipif(find_spec("airo_models") is None, reason="needs neugrasp[robot]")


def pad_at(crank: float) -> tuple[float, float, float]:
    """Distance between the pads, height of their middle, and tilt of a pad, of the package's 2F-85 with its
    crank at an angle: all joints followed, those that mimic among them."""
    file = Path(str(resources.files("airo_models") / "grippers/robotiq_2f_85/urdf/robotiq_2f_85.urdf"))
    text = re.sub(r"<drake:.*?>|</drake:.*?>|drake:\w+=\"[^\"]*\"", "", file.read_text())
    robot = ElementTree.fromstring(text)
    joints = {joint.find("child").get("link"): joint for joint in robot.findall("joint")}  # type: ignore[union-attr]
    pose, link = np.eye(4), "right_inner_finger_pad"
    while link != "base_link_inertia":
        joint = joints[link]
        mimic = joint.find("mimic")
        factor = 1.0 if mimic is None else float(mimic.get("multiplier", "1"))
        angle = factor * crank if joint.get("type") == "revolute" else 0.0
        origin = joint.find("origin")
        assert origin is not None
        xyz, rpy = ([float(x) for x in origin.attrib[key].split()] for key in ("xyz", "rpy"))
        turn = rigid(Rotation.from_euler("x", angle).as_matrix())
        pose = rigid(Rotation.from_euler("xyz", rpy).as_matrix(), xyz) @ turn @ pose
        link = joint.find("parent").attrib["link"]  # type: ignore[union-attr]
    pad = next(one for one in robot.findall("link") if one.get("name") == "right_inner_finger_pad")
    box = pad.find("collision/geometry/box")
    assert box is not None
    thickness = float(box.attrib["size"].split()[1])
    tilt = float(np.arccos(np.clip(pose[2, 2], -1, 1)))
    return 2 * (abs(pose[1, 3]) - thickness / 2), float(pose[2, 3]), tilt


@pytest.mark.slow
@needs_models
def test_at_every_opening_the_pads_are_where_the_linkage_has_them():
    """To a hundredth of a millimetre over the whole way; the pads stay parallel."""
    assert HAND.finger_arc is not None
    openings, heights, tilts = np.array([pad_at(crank) for crank in np.linspace(0.01, 0.87, 300)]).T
    assert openings.max() > 0.085
    inside = (openings >= 0) & (openings <= HAND.max_opening)
    assert inside.sum() > 250
    closed = np.interp(0.0, openings[::-1], heights[::-1])
    setback = HAND.tip_setback(openings[inside])
    assert np.abs(closed - heights[inside] - setback).max() < 2e-5
    assert np.abs(tilts).max() < 1e-6
    assert setback.max() == pytest.approx(0.0134, abs=2e-4)
    assert HAND.tcp_height == pytest.approx(closed, abs=3e-4)


@pytest.mark.slow
@given(st.floats(0, 0.085))
def test_hulls_wires_and_filter_have_the_pads_at_the_grasp(width: float):
    """Whatever the width, the middle of the pads of a hand that stands for a grasp is at the grasp."""
    grasp = Grasp(down_at(0.5, 0.0, 0.1), width)
    tool = Tool.of(HAND, np.eye(4))
    flange = tool.standing(grasp).pose @ rigid(translation=(0, 0, -HAND.tcp_height))
    tip = max(middle(flange, hull)[1] for hull in tool.fingers_at(width))
    assert tip == pytest.approx(HAND.tip_height - HAND.tcp_height, abs=1e-9)
    pads = [hull for hull in tool.fingers_at(width) if abs(np.abs(hull[:, 1]).min() - width / 2) < 1e-9]
    assert len(pads) == 2
    standing = CollisionFilter(HAND).standing(grasp.pose[None], np.array([width]))[0]
    np.testing.assert_allclose(standing, tool.standing(grasp).pose, atol=1e-12)
    np.testing.assert_allclose(tool.reached(tool.standing(grasp)).pose, grasp.pose, atol=1e-12)
    wires = HAND.wireframe(width)
    assert wires[1, 0, 2] == pytest.approx(HAND.palm_height - HAND.tcp_height + HAND.tip_setback(width))
    assert wires[1, 1, 2] == pytest.approx(HAND.tip_height - HAND.tcp_height)


def middle(flange: Array, hull: Array) -> tuple[float, float]:
    """Least and most, metres ahead of the grasp along its approach, straight down from 10 cm."""
    heights = 0.1 - (hull @ flange[:3, :3].T + flange[:3, 3])[:, 2]
    return float(heights.min()), float(heights.max())


def test_straight_fingers_stay_as_they_were():
    panda = Gripper.load("panda")
    assert panda.finger_arc is None
    assert not panda.tip_setback(np.linspace(0, 0.08, 9)).any()
    assert "finger_arc" not in panda.to_dict()
    assert Gripper.from_dict(panda.to_dict()).to_dict() == panda.to_dict()
    grasp = Grasp(down_at(0.5, 0.0, 0.1), 0.05)
    np.testing.assert_array_equal(Tool.of(panda, np.eye(4)).standing(grasp).pose, grasp.pose)


def test_an_arc_is_read_back_and_one_that_is_too_small_is_refused():
    assert Gripper.from_dict(HAND.to_dict()).finger_arc == HAND.finger_arc
    assert HAND.finger_arc is not None
    short = replace(HAND, finger_arc=replace(HAND.finger_arc, radius=0.03)).to_dict()
    with pytest.raises(InputError, match="finger_arc is too small"):
        Gripper.from_dict(short)


def test_the_filter_sees_the_tips_where_they_close():
    """Open tips are 13 mm short of the table that closed ones would meet: such a grasp is none."""
    workspace, hand = Workspace(), CollisionFilter(HAND)
    heights = workspace.voxel_centres()[..., 2]
    table = ((heights - workspace.table_height) / workspace.truncation).clip(-1, 1).astype(np.float32)
    tips = HAND.tip_height - HAND.tcp_height
    low, high = (down_at(0.15, 0.15, workspace.table_height + tips + gap)[None] for gap in (-0.008, 0.002))
    for width in (0.02, 0.08):
        assert hand.clearance(table, workspace, low, np.array([width]))[0] < -0.2
        assert hand.clearance(table, workspace, high, np.array([width]))[0] > 0
