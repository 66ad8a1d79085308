"""Executed grasps: what must be lifted is lifted, what must fail fails for the right reason."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from neugrasp.data.world import Body, Scene
from neugrasp.errors import InputError
from neugrasp.execution import AT_PREGRASP, NOTHING_HELD, ON_APPROACH, SLIPPED, SUCCESS
from neugrasp.geometry.pose import from_quaternion, rigid, rotation_about
from neugrasp.grasp import Grasp
from neugrasp.simulation.grasp_execution import execute
from neugrasp.simulation.grasp_sampling import facing, label, middle_of_widest_run
from neugrasp.simulation.physics import World

Toy = Callable[..., Body]
Lay = Callable[..., Scene]
DOWN = np.diag([1.0, -1.0, -1.0])
"""Approaches straight down, closes along the world's y."""
TABLE = 0.05


def from_above(position: tuple[float, float, float], yaw: float = 0.0) -> Grasp:
    return Grasp(rigid(DOWN @ rotation_about((0, 0, 1), yaw), position), 0.08)


def slab(toy: Toy, thickness: float) -> Body:
    """A slab 6 cm wide along x and 8 cm tall."""
    return toy(f"box 0.06 {thickness} 0.08", (0.15, 0.15, TABLE + 0.0405))


@pytest.mark.parametrize("yaw", [0.0, np.pi])
def test_a_box_is_lifted(world: World, toy: Toy, lay: Lay, yaw: float) -> None:
    lay(slab(toy, 0.04))
    trial = execute(world, from_above((0.15, 0.15, 0.11), yaw), allow_contact=True)
    assert (trial.success, trial.reason, trial.body) == (True, SUCCESS, 0)
    # The engine keeps a millimetre around each of the four surfaces that meet.
    assert trial.width == pytest.approx(0.044, abs=0.001)
    assert world.bodies()[0].position[2] == pytest.approx(TABLE + 0.14, abs=0.01)


def test_the_fingers_close_along_y(world: World, toy: Toy, lay: Lay) -> None:
    """The same box, wider than the gripper in the other direction."""
    body = toy("box 0.1 0.03 0.08", (0.15, 0.15, TABLE + 0.0405))
    lay(body)
    assert execute(world, from_above((0.15, 0.15, 0.11))).success
    lay(body)
    assert execute(world, from_above((0.15, 0.15, 0.11), np.pi / 2)).reason == ON_APPROACH


def test_the_gripper_approaches_along_z(world: World, toy: Toy, lay: Lay) -> None:
    """From the side of -x, level: the box is lifted, because a side grasp retreats upwards."""
    lay(toy("box 0.04 0.04 0.14", (0.15, 0.15, TABLE + 0.0705)))
    approach_x = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    trial = execute(world, Grasp(rigid(approach_x, (0.145, 0.15, 0.14)), 0.08))
    assert trial.success
    assert world.bodies()[0].position[2] == pytest.approx(TABLE + 0.17, abs=0.01)


def test_a_box_wider_than_the_gripper_is_not_lifted(world: World, toy: Toy, lay: Lay) -> None:
    body = toy("box 0.09 0.09 0.08", (0.15, 0.15, TABLE + 0.0405))
    for allow_contact in (False, True):
        lay(body)
        trial = execute(world, from_above((0.15, 0.15, 0.11)), allow_contact=allow_contact)
        assert not trial.success
        assert world.bodies()[0].position[2] == pytest.approx(TABLE + 0.04, abs=0.005)
    lay(body)
    assert execute(world, from_above((0.15, 0.15, 0.11))).reason == ON_APPROACH


def test_air_cannot_be_held(world: World, lay: Lay) -> None:
    lay()
    trial = execute(world, from_above((0.15, 0.15, 0.2)))
    assert (trial.success, trial.reason, trial.width) == (False, NOTHING_HELD, 0.08)


def test_the_table_counts_as_a_collision(world: World, lay: Lay) -> None:
    lay()
    assert execute(world, from_above((0.15, 0.15, TABLE + 0.005))).reason == ON_APPROACH
    assert execute(world, from_above((0.15, 0.15, TABLE - 0.045))).reason == AT_PREGRASP
    assert execute(world, from_above((0.15, 0.15, TABLE + 0.015))).reason == NOTHING_HELD


def test_a_contact_ends_the_approach_and_the_grasp_only_where_it_is_not_allowed(
    world: World, toy: Toy, lay: Lay
) -> None:
    """The fingers come down on the table beside the box, a little too deep."""
    body = toy("box 0.06 0.04 0.04", (0.15, 0.15, TABLE + 0.0205))
    grasp = from_above((0.15, 0.15, TABLE + 0.005))
    lay(body)
    assert execute(world, grasp).reason == ON_APPROACH
    lay(body)
    assert execute(world, grasp, allow_contact=True).success


def test_the_rules_differ_in_how_thin_a_thing_may_be(world: World, toy: Toy, lay: Lay) -> None:
    """More than 4 mm must remain under the paper's rule, 8 mm under VGN's; 4 mm come from the engine."""
    for thickness, paper, vgn in ((0.002, True, False), (0.006, True, True)):
        for rule, expected in (("paper", paper), ("vgn", vgn)):
            lay(slab(toy, thickness))
            assert execute(world, from_above((0.15, 0.15, 0.11)), rule).success == expected


def test_an_unknown_rule_is_refused_before_anything_moves(world: World, lay: Lay) -> None:
    lay()
    with pytest.raises(InputError, match=r"'strict'.*paper, vgn"):
        execute(world, from_above((0.15, 0.15, 0.2)), rule="strict")


def test_what_is_held_can_be_taken_away_and_the_rest_settles(world: World, toy: Toy, lay: Lay) -> None:
    stacked = toy("box 0.1 0.1 0.02", (0.15, 0.15, TABLE + 0.09))
    lay(toy("ball 0.02", (0.06, 0.06, TABLE + 0.021)), slab(toy, 0.04))
    trial = execute(world, from_above((0.15, 0.15, 0.11)))
    assert trial.body == 1
    world.remove(trial.body)
    world.settle()
    assert [body.name for body in world.bodies()] == ["ball 0.02"]
    world.add(stacked)
    world.settle()
    assert world.bodies()[1].position[2] == pytest.approx(TABLE + 0.01, abs=2e-3)


def clutter(toy: Toy) -> tuple[Body, ...]:
    return (
        slab(toy, 0.03),
        toy("box 0.04 0.04 0.05", (0.22, 0.19, TABLE + 0.0255)),
        toy("ball 0.025", (0.12, 0.21, TABLE + 0.0255)),
    )


@pytest.mark.slow
def test_trials_do_not_depend_on_their_order(world: World, toy: Toy, lay: Lay) -> None:
    lay(*clutter(toy))
    grasps = [
        from_above((0.15, 0.15, 0.11)),
        from_above((0.22, 0.19, 0.08), 0.4),
        from_above((0.12, 0.21, 0.08)),
    ]
    world.hand()
    state = world.save()

    def outcomes(order: list[int]) -> dict[int, object]:
        result: dict[int, object] = {}
        for i in order:
            world.restore(state)
            result[i] = (execute(world, grasps[i], allow_contact=True), world.bodies())
        return result

    assert outcomes([0, 1, 2]) == outcomes([2, 1, 0])


@pytest.mark.slow
def test_labels_hold_when_they_are_executed(world: World, toy: Toy, lay: Lay) -> None:
    lay(*clutter(toy))
    world.settle()
    scene = Scene("packed", 0, world.bodies())
    world.reset(scene)
    before = world.bodies()
    found = label(world, np.random.default_rng(0), num_points=24)
    labels = found.labels
    assert world.bodies() == before
    assert len(labels.points) == 24
    assert 3 <= labels.success.sum() < 24
    assert len(found.trials) == len(found.poses) == 24 * 6
    for i in np.flatnonzero(labels.success)[:6]:
        world.reset(scene)
        pose = from_quaternion(labels.quaternions[i], labels.points[i])
        trial = execute(world, Grasp(pose, 0.08).advanced(world.gripper.tcp_depth))
        assert trial.success
        assert trial.width == pytest.approx(labels.widths[i], abs=1e-3)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_labels(world: World, toy: Toy, lay: Lay) -> None:
    found = []
    for _ in range(2):
        lay(*clutter(toy))
        found.append(label(world, np.random.default_rng(3), num_points=6))
        execute(world, from_above((0.15, 0.15, 0.11)))
    for name in ("points", "quaternions", "widths", "success"):
        assert np.array_equal(getattr(found[0].labels, name), getattr(found[1].labels, name))
    assert found[0].trials == found[1].trials


def test_grasp_points_lie_before_visible_surface_and_look_at_it(world: World, toy: Toy, lay: Lay) -> None:
    centre, radius = np.array([0.15, 0.15, TABLE + 0.0305]), 0.03
    lay(toy(f"ball {radius}", tuple(centre.tolist())))
    labels = label(world, np.random.default_rng(0), num_points=30, num_yaws=1).labels
    for point, quaternion in zip(labels.points, labels.quaternions, strict=True):
        distance = np.linalg.norm(point - centre) - radius
        assert -0.1 * 0.05 - 1e-3 < distance < 1.1 * 0.05 + 1e-3
        approach = from_quaternion(quaternion)[:3, 2]
        assert approach @ (centre - point) / np.linalg.norm(centre - point) > 0.99
        assert approach[2] < 0.15


def test_an_empty_table_has_no_labels(world: World, lay: Lay) -> None:
    lay()
    labels = label(world, np.random.default_rng(0), num_points=5).labels
    assert labels.points.shape == (0, 3)
    assert labels.quaternions.shape == (0, 4)


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("000000", None),
        ("010000", 1),
        ("011100", 2),
        ("100011", 5),
        ("110111", 5),
        ("101100", 2),
        ("111111", 2),
    ],
)
def test_the_middle_of_the_widest_run_is_found_on_the_circle(pattern: str, expected: int | None) -> None:
    assert middle_of_widest_run([sign == "1" for sign in pattern]) == expected


def test_facing_is_a_rotation_for_every_approach() -> None:
    rng = np.random.default_rng(0)
    for approach in [*rng.normal(size=(20, 3)), np.array([1.0, 0, 0]), np.array([-1.0, 0, 0])]:
        unit = approach / np.linalg.norm(approach)
        rotation = facing(unit)
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)
        np.testing.assert_allclose(rotation[:, 2], unit, atol=1e-12)


def test_a_smooth_wedge_slips_out(world: World, toy: Toy, lay: Lay) -> None:
    """Fingers that close on the upper half of a ball press it down and out."""
    lay(toy("ball 0.035", (0.15, 0.15, TABLE + 0.0355)))
    trial = execute(world, from_above((0.15, 0.15, TABLE + 0.075)), allow_contact=True)
    assert trial.reason in (SLIPPED, NOTHING_HELD)
