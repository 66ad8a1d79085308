"""A grasp carried out through the protocols of a robot cell."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from neugrasp.geometry.pose import Array, rigid, rotation_about
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.robot.pick import COLLISION, NOTHING_HELD, SUCCESS, pick
from neugrasp.robot.simulated import SimulatedRobot
from neugrasp.simulation.grasp_execution import execute
from neugrasp.simulation.physics import World
from toy_boxes import DOWN, Boxes, box, boxes_scene, grasp_of

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    with World(Workspace(), Boxes(tmp_path_factory.mktemp("boxes"))) as world:
        yield world


class PaperRobot:
    """Writes down what it is told; its gripper has these openings, one after the other."""

    max_opening = 0.08

    def __init__(self, openings: list[float], reachable: bool = True, contact: bool = False):
        self.openings, self.reachable, self.contact = openings, reachable, contact
        self.done: list[str] = []
        self.places: list[Array] = []

    def move_to_pose(self, world_from_tcp: Array) -> bool:
        self.done.append("go")
        self.places.append(world_from_tcp[:3, 3])
        return self.reachable

    def move_straight(self, position: Array, stop_on_contact: bool) -> bool:
        self.done.append("until contact" if stop_on_contact else "move")
        self.places.append(position)
        return self.contact and stop_on_contact

    def place_in_bin(self) -> bool:
        self.done.append("deliver")
        return True

    def retract(self) -> None:
        self.done.append("leave")

    def open(self) -> None:
        self.done.append("open")

    def close(self) -> None:
        self.done.append("close")

    def opening(self) -> float:
        return self.openings.pop(0) if len(self.openings) > 1 else self.openings[0]

    def holds(self) -> bool:
        return True


def test_a_grasp_is_approached_closed_lifted_and_delivered():
    robot = PaperRobot([0.04])
    grasp = Grasp(rigid(DOWN, (0.1, 0.2, 0.1)), 0.04)
    result = pick(robot, robot, grasp, 0.004, UP)
    assert result.success
    assert not result.touched
    assert robot.done == ["open", "go", "until contact", "close", "move", "deliver"]
    np.testing.assert_allclose(robot.places, [(0.1, 0.2, 0.15), (0.1, 0.2, 0.1), (0.1, 0.2, 0.2)])


def test_a_grasp_from_the_side_is_lifted_straight_up():
    robot = PaperRobot([0.04])
    grasp = Grasp(rigid(rotation_about((0, 1, 0), np.pi / 2), (0.1, 0.2, 0.1)), 0.04)
    pick(robot, robot, grasp, 0.004, UP)
    np.testing.assert_allclose(robot.places[-1], (0.1, 0.2, 0.2), atol=1e-12)


@pytest.mark.parametrize(
    ("robot", "reason"),
    [
        (PaperRobot([0.08], reachable=False), "collision on the way"),
        (PaperRobot([0.003], contact=True), "collision on the way"),
        (PaperRobot([0.003]), "nothing between the fingers"),
        (PaperRobot([0.03, 0.002]), "slipped on lifting"),
    ],
)
def test_failures_are_told_apart_and_end_with_the_hand_out_of_the_way(robot: PaperRobot, reason: str):
    result = pick(robot, robot, Grasp(rigid(DOWN, (0.1, 0.2, 0.1)), 0.04), 0.004, UP)
    assert not result.success
    assert result.reason == reason
    assert robot.done[-1] == "leave"
    assert "deliver" not in robot.done


@pytest.mark.parametrize(("min_opening", "success"), [(0.004, True), (0.008, False)])
def test_six_millimetres_are_a_success_for_the_paper_and_not_for_vgn(min_opening: float, success: bool):
    robot = PaperRobot([0.006])
    assert pick(robot, robot, Grasp(rigid(DOWN), 0.01), min_opening, UP).success is success


def test_what_is_delivered_is_gone_and_the_others_keep_their_materials(world: World):
    bodies = [box(0.08, 0.08), box(0.22, 0.1), box(0.15, 0.22)]
    robot = SimulatedRobot(world, boxes_scene(*bodies))
    assert robot.count() == 3
    assert pick(robot, robot, grasp_of(bodies[1]), 0.004, UP).reason == SUCCESS
    left = robot.scene()
    assert [material.preset for material in left.materials] == ["material 0", "material 2"]
    np.testing.assert_allclose([b.position[:2] for b in left.bodies], [(0.08, 0.08), (0.15, 0.22)], atol=1e-3)


def test_an_object_that_leaves_the_workspace_takes_its_material_with_it(world: World):
    bodies = [box(0.08, 0.08, "0.03 0.05 0.061"), box(0.22, 0.1, "0.03 0.05 0.062")]
    robot = SimulatedRobot(world, boxes_scene(*bodies))
    world.place(0, box(0.4, 0.4, "0.03 0.05 0.061"))
    robot.retract()
    assert robot.count() == 1
    assert [material.preset for material in robot.scene().materials] == ["material 1"]


def test_a_closed_hand_in_the_air_holds_nothing(world: World):
    robot = SimulatedRobot(world, boxes_scene(box(0.08, 0.08)))
    result = pick(robot, robot, Grasp(rigid(DOWN, (0.2, 0.2, 0.25)), 0.04), 0.004, UP)
    assert result.reason == NOTHING_HELD
    assert robot.count() == 1


def test_without_table_contact_the_hand_goes_through_to_the_grasp(world: World):
    """5 mm lower than the finger tips can go."""
    body = box(0.15, 0.15, "0.03 0.05 0.02")
    lying = rigid(DOWN @ rotation_about((0, 0, 1), np.pi / 2), (0.15, 0.15, 0.054))
    feels = SimulatedRobot(world, boxes_scene(body))
    assert pick(feels, feels, Grasp(lying, 0.03), 0.004, UP).touched
    numb = SimulatedRobot(world, boxes_scene(body), table_contact=False)
    assert not pick(numb, numb, Grasp(lying, 0.03), 0.004, UP).touched


@pytest.mark.slow
@pytest.mark.parametrize("sideways", [0.0, 0.012, 0.03, 0.05])
@pytest.mark.parametrize("yaw", [0.0, 0.6])
def test_it_comes_out_as_in_the_trials_that_make_the_labels(world: World, sideways: float, yaw: float):
    body = box(0.15, 0.15)
    middle = grasp_of(body)
    pose = middle.pose @ rigid(rotation_about((0, 0, 1), yaw), (0, sideways, 0))
    world.reset(boxes_scene(body))
    trial = execute(world, Grasp(pose, 0.03), rule="paper", allow_contact=True)
    robot = SimulatedRobot(world, boxes_scene(body))
    result = pick(robot, robot, Grasp(pose, 0.03), 0.05 * world.gripper.max_opening, UP)
    assert result.success == trial.success
    if trial.success:
        assert result.opening == pytest.approx(trial.width)
    elif trial.reason == "collision at the pre-grasp":
        assert result.reason == COLLISION
