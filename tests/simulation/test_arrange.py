"""Arranged scenes: at rest, inside the workspace, and a function of their seed alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from neugrasp.data.world import Body, Scene
from neugrasp.errors import InputError
from neugrasp.geometry.pose import from_quaternion
from neugrasp.simulation.arrange import LAYERS, arrange
from neugrasp.simulation.physics import World

CHOICES = [("toys", f"box {x} {y} 0.05") for x in (0.03, 0.04) for y in (0.03, 0.05)]


@pytest.mark.parametrize("kind", list(LAYERS))
def test_the_same_seed_gives_the_same_scene_whatever_came_before(world: World, kind: str) -> None:
    first = arrange(kind, 5, world, CHOICES, num_objects=3)
    other = arrange(kind, 6, world, CHOICES, num_objects=3)
    assert arrange(kind, 5, world, CHOICES, num_objects=3) == first
    assert other.bodies != first.bodies


@pytest.mark.parametrize(("kind", "count"), [("pile", 5), ("packed", 4), ("single", 1)])
def test_a_scene_rests_inside_the_workspace_on_the_table(world: World, kind: str, count: int) -> None:
    scene = arrange(kind, 1, world, CHOICES, num_objects=count)
    assert (scene.kind, scene.seed, scene.materials) == (kind, 1, ())
    assert 1 <= len(scene.bodies) <= count
    world.reset(scene)
    world.step(120)
    for before, after in zip(scene.bodies, world.bodies(), strict=True):
        assert np.linalg.norm(np.subtract(before.position, after.position)) < 2e-3
        assert np.all(np.array(after.position) > (0, 0, 0.05))
        assert max(after.position) < 0.3


def test_packed_objects_stand_upright_and_apart(world: World) -> None:
    scene = arrange("packed", 2, world, CHOICES, num_objects=4)
    assert len(scene.bodies) == 4
    for body in scene.bodies:
        assert 0.7 <= body.scale <= 0.9
        assert from_quaternion(body.quaternion_xyzw)[2, 2] > 0.999
        assert body.position[2] == pytest.approx(0.05 + 0.025 * body.scale, abs=1.5e-3)


def test_a_single_object_stands_in_the_middle(world: World) -> None:
    (body,) = arrange("single", 3, world, CHOICES).bodies
    np.testing.assert_allclose(body.position[:2], (0.15, 0.15), atol=2e-3)


@pytest.mark.parametrize("kind", ["packed", "single"])
@pytest.mark.parametrize("middle", [-0.03, 0.03])
def test_objects_stand_wherever_their_mesh_has_its_origin(world: World, kind: str, middle: float) -> None:
    scene = arrange(kind, 3, world, [("toys", f"box 0.04 0.04 0.05 0 {middle}")], num_objects=1)
    (body,) = scene.bodies
    assert from_quaternion(body.quaternion_xyzw)[2, 2] > 0.999
    assert body.position[2] + middle * body.scale == pytest.approx(0.05 + 0.025 * body.scale, abs=1.5e-3)


@pytest.mark.slow
def test_training_scenes_have_one_object_and_four_more_on_average(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts = []
    monkeypatch.setitem(LAYERS, "pile", lambda world, rng, choices, count: counts.append(count))
    for seed in range(400):
        arrange("pile", seed, world, CHOICES)
    assert min(counts) == 1
    assert np.mean(counts) == pytest.approx(5, abs=0.4)


def test_no_room_is_no_error(world: World) -> None:
    scene = arrange("packed", 0, world, [("toys", "box 0.25 0.25 0.05")], num_objects=5)
    assert 1 <= len(scene.bodies) < 5


def test_bad_requests_are_named(world: World) -> None:
    with pytest.raises(InputError, match=r"'heap'.*pile, packed, single"):
        arrange("heap", 0, world, CHOICES)
    with pytest.raises(InputError, match="no objects"):
        arrange("pile", 0, world, [])


def test_a_rebuilt_scene_is_the_scene(world: World, toy: Callable[..., Body]) -> None:
    scene = arrange("pile", 4, world, CHOICES, num_objects=3)
    world.reset(Scene("pile", 0, (toy("ball 0.02", (0.1, 0.1, 0.1)),)))
    world.reset(scene)
    for put, found in zip(scene.bodies, world.bodies(), strict=True):
        np.testing.assert_allclose(put.position, found.position, atol=1e-12)
        np.testing.assert_allclose(put.quaternion_xyzw, found.quaternion_xyzw, atol=1e-12)
