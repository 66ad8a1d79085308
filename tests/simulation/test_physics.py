"""The simulated world: gravity, rest, exact repetition, and exact images."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from neugrasp.data.world import Body, Scene
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import from_quaternion, look_at, rigid
from neugrasp.simulation.physics import TIME_STEP, World

Toy = Callable[..., Body]
Lay = Callable[..., Scene]
TABLE = 0.05


def heights(world: World) -> list[float]:
    return [body.position[2] for body in world.bodies()]


def test_a_cube_in_free_fall_drops_by_half_g_t_squared(world: World, toy: Toy, lay: Lay) -> None:
    lay(toy("box 0.04 0.04 0.04", (0.15, 0.15, 1.0)))
    world.step(72)
    fallen, seconds = 1.0 - heights(world)[0], 72 * TIME_STEP
    assert fallen == pytest.approx(9.81 * seconds**2 / 2, rel=0.03)


def test_a_settled_cube_stands_on_the_table(world: World, toy: Toy, lay: Lay) -> None:
    lay(toy("box 0.05 0.05 0.04", (0.15, 0.15, 0.08)))
    world.settle()
    assert heights(world) == pytest.approx([TABLE + 0.02], abs=1.5e-3)


def test_a_body_that_leaves_the_workspace_is_taken_out(world: World, toy: Toy, lay: Lay) -> None:
    kept = toy("box 0.05 0.05 0.04", (0.15, 0.15, 0.07))
    lay(toy("ball 0.02", (0.31, 0.15, 0.07)), kept, toy("ball 0.02", (0.15, -0.9, 0.07)))
    world.settle()
    assert [body.name for body in world.bodies()] == [kept.name]


def test_a_body_is_where_it_was_put_although_its_mass_is_not_at_its_origin(
    world: World, toy: Toy, lay: Lay, tilted: tuple[float, float, float, float]
) -> None:
    put = toy("box 0.04 0.04 0.04 0.1", (0.12, 0.17, 0.2), tilted, scale=0.7)
    lay(put)
    (found,) = world.bodies()
    np.testing.assert_allclose(found.position, put.position, atol=1e-7)
    np.testing.assert_allclose(found.quaternion_xyzw, tilted, atol=1e-7)
    _, mask = world.depth_and_mask(above(eye=(0.5, 0.3, 0.6)))
    centre = from_quaternion(tilted, put.position) @ [0.07, 0, 0, 1]
    rows, columns = np.nonzero(mask == 1)
    pixel, _ = above(eye=(0.5, 0.3, 0.6)).project(centre[:3])
    np.testing.assert_allclose([columns.mean(), rows.mean()], pixel, atol=2)


def test_settling_twice_from_one_scene_gives_the_same_bits(
    world: World, toy: Toy, lay: Lay, tilted: tuple[float, float, float, float]
) -> None:
    bodies = [toy(f"box 0.0{k + 3} 0.04 0.06", (0.13, 0.15, 0.1 + 0.08 * k), tilted) for k in range(3)]
    scene = lay(*bodies)
    world.settle()
    first = world.bodies()
    world.hand().place(rigid(translation=(0.15, 0.15, 0.2)))
    world.step(50)
    world.reset(scene)
    world.settle()
    assert world.bodies() == first


def test_a_restored_state_has_no_memory_of_what_happened_since(world: World, toy: Toy, lay: Lay) -> None:
    lay(toy("box 0.05 0.04 0.06", (0.15, 0.15, 0.081)), toy("ball 0.03", (0.2, 0.15, 0.08)))
    hand = world.hand()
    state = world.save()

    def after() -> tuple[Body, ...]:
        world.restore(state)
        hand.place(rigid(np.diag([1.0, -1.0, -1.0]), (0.15, 0.15, 0.09)))
        hand.close()
        return world.bodies()

    first = after()
    world.restore(state)
    hand.place(rigid(np.diag([1.0, -1.0, -1.0]), (0.19, 0.16, 0.08)))
    hand.close()
    assert after() == first
    world.forget(state)


def test_numbers_of_later_bodies_move_down_when_one_is_taken_out(world: World, toy: Toy, lay: Lay) -> None:
    lay(*(toy("ball 0.02", (0.07 + 0.07 * k, 0.15, 0.07)) for k in range(3)))
    world.remove(0)
    camera = above(eye=(0.15, 0.15, 0.6))
    _, mask = world.depth_and_mask(camera)
    for i, body in enumerate(world.bodies()):
        u, v = np.rint(camera.project(np.array(body.position))[0]).astype(int)
        assert mask[v, u] == i + 1
    assert mask.max() == 2


def test_the_nearest_body_is_that_of_the_nearest_surface(world: World, toy: Toy, lay: Lay) -> None:
    point = np.array([0.155, 0.15, 0.1])
    lay()
    assert world.nearest(point) is None
    near, far = toy("ball 0.01", (0.2, 0.15, 0.1)), toy("ball 0.04", (0.1, 0.15, 0.1))
    for bodies in ((near, far), (far, near)):
        lay(*bodies)
        # 35 mm from the small ball, whose centre is nearer, 15 mm from the large one.
        assert bodies[world.nearest(point)] == far
        assert bodies[world.nearest(np.array(near.position))] == near, "inside it"
    world.remove(0)
    assert world.nearest(point) == 0


def above(eye: tuple[float, float, float], target: tuple[float, float, float] = (0.15, 0.15, 0.05)) -> Camera:
    """A camera whose principal point is nowhere near the middle and whose sides are odd and even."""
    intrinsics = np.array([[310.0, 0, 97.3], [0, 325.0, 150.6], [0, 0, 1]])
    return Camera(intrinsics, look_at(eye, target), 241, 200)


def rays(camera: Camera) -> np.ndarray:
    """Directions (h, w, 3) of unit z-depth."""
    return camera.unproject(camera.pixel_grid(), np.ones((camera.height, camera.width))) - camera.centre


def test_depth_of_the_table_is_that_of_its_plane(world: World, lay: Lay) -> None:
    lay()
    camera = above(eye=(0.5, 0.3, 0.6))
    depth, mask = world.depth_and_mask(camera)
    expected = (TABLE - camera.centre[2]) / rays(camera)[..., 2]
    assert mask.dtype == np.int16
    assert depth.dtype == np.float32
    assert np.mean(mask == 0) > 0.8
    np.testing.assert_allclose(depth[mask == 0], expected[mask == 0], atol=1e-5)


def test_depth_of_a_box_is_exact_in_every_pixel(
    world: World, toy: Toy, lay: Lay, tilted: tuple[float, float, float, float]
) -> None:
    """Half a pixel of shift would already move these slanted faces by more than a millimetre."""
    body = toy("box 0.1 0.08 0.06", (0.15, 0.13, 0.15), tilted)
    lay(body)
    world.hand().place(rigid(translation=(0.3, 0.2, 0.4)))
    camera = above(eye=(0.5, 0.3, 0.6))
    depth, mask = world.depth_and_mask(camera)
    body_from_world = np.linalg.inv(from_quaternion(tilted, body.position))
    origin = (body_from_world @ [*camera.centre, 1])[:3]
    directions = rays(camera) @ body_from_world[:3, :3].T
    half = np.array([0.05, 0.04, 0.03])
    first, second = (-half - origin) / directions, (half - origin) / directions
    enter, leave = np.minimum(first, second).max(axis=-1), np.maximum(first, second).min(axis=-1)
    hit = enter < leave
    assert hit.sum() > 1000
    assert np.sum((mask == 1) != hit) <= 2
    both = hit & (mask == 1)
    np.testing.assert_allclose(depth[both], enter[both], atol=2e-5)


def test_depth_of_a_ball_is_exact(world: World, toy: Toy, lay: Lay) -> None:
    radius, centre = 0.05, np.array([0.17, 0.12, 0.12])
    lay(toy(f"ball {radius}", tuple(centre.tolist())))
    camera = above(eye=(0.1, 0.5, 0.5))
    depth, mask = world.depth_and_mask(camera)
    directions, offset = rays(camera), camera.centre - centre
    a, b = np.sum(directions**2, axis=-1), directions @ offset
    inner = b**2 - a * (offset @ offset - radius**2)
    sure = (inner > 0.2 * inner.max()) & (mask == 1)
    expected = (-b - np.sqrt(inner.clip(0))) / a
    assert sure.sum() > 500
    np.testing.assert_allclose(depth[sure], expected[sure], atol=5e-4)


def test_where_nothing_is_the_depth_is_zero(world: World, lay: Lay) -> None:
    lay()
    level = above(eye=(0.15, -0.8, 0.2), target=(0.15, 0.15, 0.2))
    depth, mask = world.depth_and_mask(level)
    assert np.array_equal(mask == -1, depth == 0)
    assert np.all(mask[0] == -1)


def test_the_hidden_side_of_the_table_hides_what_lies_under_it(world: World, toy: Toy, lay: Lay) -> None:
    lay(toy("ball 0.02", (0.15, 0.15, -0.2)))
    _, mask = world.depth_and_mask(above(eye=(0.15, 0.1, 0.6)))
    assert np.all(mask == 0)


def test_a_body_keeps_its_scale_and_its_set(world: World, toy: Toy, lay: Lay) -> None:
    put = replace(toy("ball 0.03", (0.1, 0.1, 0.08)), scale=0.8)
    lay(put)
    world.settle()
    (found,) = world.bodies()
    assert (found.object_set, found.name, found.scale) == ("toys", "ball 0.03", 0.8)
    assert found.position[2] == pytest.approx(TABLE + 0.024, abs=1.5e-3)


def test_the_tray_is_gone_after_use(world: World, toy: Toy, lay: Lay) -> None:
    lay()
    with world.tray():
        world.add(toy("ball 0.03", (0.26, 0.15, 0.3)))
        world.rest(timeout=1.0)
        inside = world.bodies()[0].position
    assert inside[0] < 0.28 - 0.03
    world.remove(0)
    world.add(toy("box 0.05 0.05 0.05", (0.27, 0.15, 0.075)))
    world.detect_collisions()
    world.settle()
    assert world.bodies()[0].position[:2] == pytest.approx((0.27, 0.15), abs=1e-3)
