"""Which grasps are wanted: the rest is counted by its reason, and nothing is lost."""

from __future__ import annotations

import numpy as np
import pytest

from neugrasp.detection.contract import Detection
from neugrasp.detection.options import Steering
from neugrasp.detection.steering import steered
from neugrasp.errors import InputError
from neugrasp.geometry.pose import rigid, rotation_about
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper

DOWN = np.diag([1.0, -1.0, -1.0])
PLACE = rigid(rotation_about((0, 0, 1), 0.4), (1.0, 2.0, 0.7))
"""Where the workspace stands in the world."""
WORKSPACE = Workspace(world_from_workspace=PLACE)


def grasp(x: float, y: float, above_table: float, tilt_deg: float = 0.0, score: float = 0.9) -> Grasp:
    """A grasp in the world, at a place of the workspace, tilted off the vertical."""
    turned = rotation_about((1, 0, 0), np.deg2rad(tilt_deg)) @ DOWN
    return Grasp(rigid(turned, (x, y, 0.05 + above_table)), 0.04, score).moved(PLACE)


def detection(*grasps: Grasp) -> Detection:
    surface, rejected = np.ones((40, 40, 40), np.float32), {"too_narrow": 2}
    return Detection(Grasps.of(grasps), WORKSPACE, Gripper.load("panda"), surface, rejected, 0.5, 0.85)


HIGH, LOW, TILTED = grasp(0.1, 0.1, 0.1), grasp(0.2, 0.2, 0.01), grasp(0.15, 0.1, 0.1, tilt_deg=50)


@pytest.mark.parametrize(
    ("steering", "kept", "reason"),
    [
        (Steering(min_height=0.05), (HIGH, TILTED), "too_low"),
        (Steering(approach=(0, 0, -2, 30)), (HIGH, LOW), "from_another_side"),
        (Steering(top=1), (HIGH,), "beyond_the_best"),
    ],
)
def test_what_is_not_wanted_is_counted(steering: Steering, kept: tuple[Grasp, ...], reason: str):
    found = steered(detection(HIGH, LOW, TILTED), steering)
    assert found.grasps == Grasps.of(kept)
    assert found.rejected == {"too_narrow": 2, reason: 3 - len(kept)}


def test_a_region_is_a_box_of_the_world():
    x, y, z = LOW.position
    box = (x - 0.01, y - 0.01, z - 0.01, x + 0.01, y + 0.01, z + 0.01)
    found = steered(detection(HIGH, LOW, TILTED), Steering(region=box))
    assert found.grasps == Grasps.of([LOW])
    assert found.rejected["outside_the_region"] == 2


def test_without_wishes_all_stays_as_it_is():
    given = detection(HIGH, LOW)
    found = steered(given, Steering())
    assert (found.grasps, found.rejected) == (given.grasps, given.rejected)


@pytest.mark.parametrize("degrees", [1.0, 49.9, 50.1, 90.0])
def test_the_cone_ends_at_its_angle(degrees: float):
    down = PLACE[:3, :3] @ (0, 0, -1)
    found = steered(detection(TILTED), Steering(approach=(*down, degrees)))
    assert bool(found.grasps) == (degrees > 50)


@pytest.mark.parametrize(
    ("wishes", "message"),
    [
        ({"region": (0, 0, 0, 1, 1, -1)}, "--region 0 0 0 1 1 -1: give the lower corner"),
        ({"region": (0, 0, float("nan"), 1, 1, 1)}, "--region"),
        ({"approach": (0, 0, 0, 30)}, "--approach 0 0 0 30"),
        ({"approach": (0, 0, -1, 0)}, "--approach 0 0 -1 0"),
        ({"approach": (0, 0, float("nan"), 30)}, "--approach"),
        ({"top": 0}, "--top 0"),
    ],
)
def test_wishes_that_cannot_be(wishes: dict[str, object], message: str):
    with pytest.raises(InputError, match=message):
        Steering(**wishes)
