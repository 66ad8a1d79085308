"""Grasps tried in series end as they end one by one, in any order, and leave no trace."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from neugrasp.data.world import Body, Scene
from neugrasp.errors import InputError
from neugrasp.execution import AT_PREGRASP, NOTHING_HELD, ON_APPROACH, SUCCESS
from neugrasp.geometry.pose import Array, rigid, rotation_about
from neugrasp.grasp import Grasp
from neugrasp.simulation.batched_trials import execute_each
from neugrasp.simulation.grasp_execution import Trial, execute
from neugrasp.simulation.grasp_sampling import at_tcp, candidates, grasp_poses
from neugrasp.simulation.physics import World

Toy = Callable[..., Body]
Lay = Callable[..., Scene]
DOWN = np.diag([1.0, -1.0, -1.0])
TABLE = 0.05
COLLISIONS = (AT_PREGRASP, ON_APPROACH)


@pytest.fixture
def clutter(world: World, toy: Toy, lay: Lay) -> Scene:
    """A slab, a box that leans on it, a ball and a box whose mass is not at its origin; settled."""
    lean = (0.0, float(np.sin(0.1)), 0.0, float(np.cos(0.1)))
    lay(
        toy("box 0.03 0.06 0.08", (0.15, 0.15, TABLE + 0.0405)),
        toy("box 0.03 0.04 0.1", (0.118, 0.15, TABLE + 0.054), lean),
        toy("ball 0.025", (0.2, 0.21, TABLE + 0.0255)),
        toy("box 0.04 0.05 0.05 0.04", (0.19, 0.09, TABLE + 0.0255)),
    )
    world.settle()
    return Scene("packed", 0, world.bodies())


def poses_around(world: World, seed: int, count: int) -> Array:
    points, rotations = candidates(world, np.random.default_rng(seed), count)
    return at_tcp(grasp_poses(points, rotations, 3), world.gripper).reshape(-1, 4, 4)


def one_by_one(world: World, poses: Array) -> list[Trial]:
    """Each with a gripper of its own, which goes there in physics."""
    world.remove_hand()
    state = world.save()
    trials = []
    for pose in poses:
        world.restore(state)
        trials.append(execute(world, Grasp(pose, world.gripper.max_opening)))
        world.remove_hand()
    world.restore(state)
    world.forget(state)
    return trials


@pytest.mark.slow
def test_a_series_ends_as_its_trials_do_one_by_one(world: World, clutter: Scene) -> None:
    world.reset(clutter)
    poses = poses_around(world, 0, 60)
    series = execute_each(world, poses)
    world.reset(clutter)
    single = one_by_one(world, poses)
    assert [trial.reason for trial in series] == [trial.reason for trial in single]
    assert [trial.body for trial in series] == [trial.body for trial in single]
    assert {trial.reason for trial in series} >= {SUCCESS, NOTHING_HELD, *COLLISIONS}
    assert len({trial.body for trial in series if trial.success}) >= 3
    differences = [abs(a.width - b.width) for a, b in zip(series, single, strict=True) if a.success]
    assert np.median(differences) < 5e-4


@pytest.mark.slow
def test_geometry_foresees_the_collisions_with_a_ball_that_rolls(world: World, toy: Toy, lay: Lay) -> None:
    """Its centre is not above where it rests: it moves by millimetres during an approach."""
    scene = lay(
        toy("ball 0.03", (0.15, 0.15, TABLE + 0.035), (0.0, 0.0, 0.0, 1.0)),
        toy("box 0.02 0.02 0.06", (0.13, 0.15, TABLE + 0.0405)),
    )
    rng = np.random.default_rng(2)
    poses = np.array(
        [
            rigid(
                rotation_about((1, 0, 0), rng.uniform(-0.8, 0.8)) @ DOWN @ rotation_about((0, 0, 1), yaw),
                (*rng.uniform(0.1, 0.2, size=2), rng.uniform(0.06, 0.14)),
            )
            for yaw in rng.uniform(0, np.pi, size=40)
        ]
    )
    series = execute_each(world, poses)
    world.reset(scene)
    single = one_by_one(world, poses)
    told = [trial.reason if trial.reason in COLLISIONS else None for trial in series]
    assert told == [trial.reason if trial.reason in COLLISIONS else None for trial in single]
    assert {None, ON_APPROACH} <= set(told)


@pytest.mark.slow
def test_what_comes_of_a_grasp_does_not_depend_on_the_others(world: World, clutter: Scene) -> None:
    """To the last bit, or labels would depend on what was labelled before."""
    world.reset(clutter)
    poses = poses_around(world, 0, 40)
    first = execute_each(world, poses)
    assert sum(trial.success for trial in first) >= 3
    world.reset(clutter)
    assert execute_each(world, poses[::-1])[::-1] == first
    world.reset(clutter)
    for k in [k for k, trial in enumerate(first) if trial.success][:3]:
        world.reset(clutter)
        assert execute_each(world, poses[k : k + 1]) == [first[k]]


def test_a_series_leaves_no_trace(world: World, clutter: Scene) -> None:
    world.reset(clutter)
    before = world.bodies()
    execute_each(world, poses_around(world, 1, 10))
    assert world.bodies() == before
    world.remove_hand()
    world.place(2, Body("toys", "ball 0.025", 1.0, (0.2, 0.21, 0.2), (0.0, 0.0, 0.0, 1.0)))
    world.step(24)
    # All bodies can move: this one fell for a tenth of a second.
    assert world.bodies()[2].position[2] == pytest.approx(0.2 - 9.81 * 0.01 / 2, abs=3e-3)


def test_no_grasp_and_an_unknown_rule(world: World, clutter: Scene) -> None:
    world.reset(clutter)
    assert execute_each(world, np.zeros((0, 4, 4))) == []
    with pytest.raises(InputError, match=r"'strict'.*paper, vgn"):
        execute_each(world, np.eye(4)[None], "strict")


def test_frozen_bodies_stay_and_free_ones_have_their_old_mass_and_inertia(
    world: World, toy: Toy, lay: Lay
) -> None:
    lay(
        toy("box 0.06 0.04 0.03 0.05", (0.1, 0.1, 0.2)),
        toy("ball 0.02", (0.2, 0.2, 0.2)),
    )
    client, uids = world._client, [placed.uid for placed in world._placed]
    dynamics = [client.getDynamicsInfo(uid, -1) for uid in uids]
    freezer = world.freezer()
    before = world.bodies()
    freezer.free(frozenset([1]))
    world.step(24)
    assert world.bodies()[0] == before[0]
    assert world.bodies()[1].position[2] < 0.16
    freezer.free_all()
    assert [client.getDynamicsInfo(uid, -1) for uid in uids] == dynamics
    world.step(24)
    assert world.bodies()[0].position[2] < 0.16


def test_a_frozen_body_lets_nothing_through_and_tells(world: World, toy: Toy, lay: Lay) -> None:
    lay(toy("box 0.04 0.04 0.04", (0.15, 0.15, TABLE + 0.1)), toy("ball 0.02", (0.15, 0.15, TABLE + 0.16)))
    freezer = world.freezer()
    freezer.free(frozenset([1]))
    world.step(4)
    assert freezer.touched() == frozenset()
    world.step(120)
    assert freezer.touched() == {0}
    assert world.bodies()[0].position[2] == pytest.approx(TABLE + 0.1, abs=1e-9)
    assert world.bodies()[1].position[2] == pytest.approx(TABLE + 0.14, abs=3e-3)
    freezer.free_all()


def test_bodies_that_hang_together_are_one_group(world: World, toy: Toy, lay: Lay) -> None:
    ground, upper = TABLE + 0.0205, TABLE + 0.0615
    lay(
        toy("box 0.04 0.04 0.04", (0.1, 0.1, ground)),
        toy("box 0.04 0.04 0.04", (0.1, 0.2, ground)),
        toy("box 0.04 0.12 0.04", (0.2, 0.1, ground)),
        toy("box 0.12 0.04 0.04", (0.15, 0.1, upper)),
    )
    world.step(60)
    world.detect_collisions()
    assert world.freezer().groups() == [{0, 2, 3}, {1}, {0, 2, 3}, {0, 2, 3}]


def test_the_way_of_what_is_held_is_looked_at(world: World, toy: Toy, lay: Lay) -> None:
    lay(toy("box 0.03 0.03 0.08", (0.15, 0.15, TABLE + 0.0405)))
    hand = world.hand()
    hand.place(rigid(DOWN, (0.15, 0.15, 0.115)))
    hand.close()
    assert hand.holds() is None
    hand.move(np.array([0.15, 0.15, 0.14]), until=lambda: False)
    held, before = hand.holds(), hand.pose()
    assert held is not None
    up, down = before[:3, 3] + (0, 0, 0.08), before[:3, 3] - (0, 0, 0.04)
    assert hand.can_carry(held, up)
    assert not hand.can_carry(held, down)
    world.add(toy("box 0.2 0.04 0.02", (0.15, 0.15, before[2, 3] + 0.19)))
    bodies = world.bodies()
    assert not hand.can_carry(held, up)
    assert hand.can_carry(held, before[:3, 3] + (0, 0, 0.01))
    assert world.bodies() == bodies
    np.testing.assert_allclose(hand.pose(), before, atol=1e-15)
