"""The mesh distance of scenes: closed forms, what is photographed, and the fused TSDF beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from neugrasp.data.world import Body
from neugrasp.geometry.fusion import fuse
from neugrasp.geometry.pose import Array, apply, from_quaternion, inverse
from neugrasp.geometry.view_sets import on_sphere
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.gt_tsdf import scan
from neugrasp.simulation.mesh_distance import mesh_distance, union_distance
from neugrasp.simulation.objects import ObjectModel
from neugrasp.simulation.physics import World
from neugrasp.simulation.placed_meshes import placed_triangles
from neugrasp.simulation.solid import signed_distance, unsigned_distance

Toy = Callable[..., Body]
TABLE = 0.05
WORKSPACE = Workspace()
CENTRES = WORKSPACE.voxel_centres()
UNITS = WORKSPACE.truncation
VOXEL = WORKSPACE.voxel_size / UNITS


def table() -> Array:
    return CENTRES[..., 2] - TABLE


def of_box(body: Body) -> Array:
    """The distance in metres of the voxel centres to a toy box."""
    edges = np.array([float(word) for word in body.name.split()[1:4]]) * body.scale
    beyond = np.abs(apply(inverse(from_quaternion(body.quaternion_xyzw, body.position)), CENTRES)) - edges / 2
    return np.linalg.norm(np.maximum(beyond, 0), axis=-1) + np.minimum(beyond.max(axis=-1), 0)


def in_units(metres: Array) -> Array:
    return np.clip(metres / UNITS, -1, 1)


def test_the_empty_table_is_a_plane(world: World) -> None:
    np.testing.assert_allclose(mesh_distance((), world._library, WORKSPACE), in_units(table()), atol=1e-6)


def test_a_box_on_the_table_is_as_its_formula_says_inside_and_behind_and_under_it(
    world: World, toy: Toy
) -> None:
    body = toy("box 0.06 0.08 0.10", (0.15, 0.15, TABLE + 0.05))
    grid = mesh_distance((body,), world._library, WORKSPACE)
    np.testing.assert_allclose(grid, in_units(np.minimum(of_box(body), table())), atol=1e-6)
    unseen = np.all(np.abs(CENTRES - body.position) < (0.02, 0.03, 0.04), axis=-1)
    assert unseen.sum() > 300
    assert np.all(grid[unseen] < -0.3)
    assert np.all(grid[CENTRES[..., 2] < TABLE] < 0)


def test_air_that_no_view_sees_is_outside(world: World, toy: Toy) -> None:
    """Under a lid on four walls; the fused TSDF says -1 there."""
    walls = [toy("box 0.005 0.10 0.06", (0.15 + s * 0.0475, 0.15, TABLE + 0.03)) for s in (-1, 1)]
    walls += [toy("box 0.10 0.005 0.06", (0.15, 0.15 + s * 0.0475, TABLE + 0.03)) for s in (-1, 1)]
    bodies = (*walls, toy("box 0.10 0.10 0.005", (0.15, 0.15, TABLE + 0.0625)))
    grid = mesh_distance(bodies, world._library, WORKSPACE)
    within = np.all(np.abs(CENTRES - (0.15, 0.15, TABLE + 0.03)) < (0.04, 0.04, 0.025), axis=-1)
    assert np.all(grid[within] > 0)


def test_bodies_are_scaled_and_turned(world: World, toy: Toy, tilted: tuple[float, ...]) -> None:
    body = toy("box 0.06 0.08 0.10", (0.15, 0.15, 0.15), tilted, scale=0.7)
    grid = mesh_distance((body,), world._library, WORKSPACE)
    np.testing.assert_allclose(grid, in_units(np.minimum(of_box(body), table())), atol=1e-6)


def test_the_union_is_the_least_of_all_bodies_and_the_table(
    world: World, toy: Toy, tilted: tuple[float, ...]
) -> None:
    """Bodies that touch, overlap, sink into the table and reach out of the cube."""
    bodies = (
        toy("box 0.06 0.08 0.10", (0.12, 0.15, 0.09), tilted),
        toy("box 0.09 0.05 0.05", (0.16, 0.16, 0.08)),
        toy("box 0.05 0.04 0.03", (0.29, 0.05, 0.06)),
        toy("box 0.02 0.02 0.02", (0.0, 0.3, 0.3)),
    )
    points = CENTRES.reshape(-1, 3)
    each = [placed_triangles(body, world.model(body)) for body in bodies]
    single = [signed_distance(points, triangles, UNITS).reshape(table().shape) for triangles in each]
    expected = in_units(np.minimum.reduce([*single, table()]))
    np.testing.assert_allclose(union_distance(each, WORKSPACE), expected, atol=1e-6)


@pytest.mark.slow
def test_moving_bodies_by_voxels_moves_the_grid(world: World, toy: Toy) -> None:
    high = [toy("box 0.05 0.04 0.03", (0.12, 0.15, 0.15)), toy("ball 0.02", (0.15, 0.17, 0.18))]
    steps = np.array([3, -2, 4])
    moved = [replace(b, position=tuple(b.position + steps * WORKSPACE.voxel_size)) for b in high]
    one, other = (mesh_distance(bodies, world._library, WORKSPACE) for bodies in (high, moved))
    rolled = np.roll(one, steps, axis=(0, 1, 2))
    far = CENTRES[..., 2] > TABLE + 0.07
    np.testing.assert_allclose(other[far], rolled[far], atol=1e-5)


class Disguised:
    """A ball to look at that other bodies feel as a large box."""

    def __init__(self, folder: Path):
        self.seen, self.felt = folder / "ball.obj", folder / "box.obj"
        trimesh.creation.icosphere(3, 0.03).export(self.seen, include_normals=False)
        trimesh.creation.box((0.1, 0.1, 0.1)).export(self.felt, include_normals=False)

    def model(self, object_set: str, name: str) -> ObjectModel:
        return ObjectModel(name, self.seen, (self.felt,), mass=0.1)


def test_its_surface_is_the_one_that_depth_images_show(tmp_path: Path, toy: Toy) -> None:
    library = Disguised(tmp_path)
    body = toy("disguised", (0.15, 0.15, TABLE + 0.05))
    camera = on_sphere(WORKSPACE, 0.5, 0.5, 1.0)
    with World(WORKSPACE, library) as world:
        world.add(body)
        depth, mask = world.depth_and_mask(camera)
    shown = camera.unproject(camera.pixel_grid(), depth.astype(np.float64))[mask == 1]
    assert len(shown) > 500
    triangles = placed_triangles(body, library.model("toys", "disguised"))
    assert unsigned_distance(shown, triangles, UNITS).max() < 1e-5
    grid = mesh_distance((body,), library, WORKSPACE)
    corner = WORKSPACE.index_of(np.array(body.position) + 0.045)
    assert grid[tuple(corner)] == 1


@pytest.fixture
def settled(world: World, toy: Toy, tilted: tuple[float, ...]) -> tuple[Body, ...]:
    """Three toys after they fell."""
    world.clear()
    world.add(toy("box 0.05 0.05 0.07", (0.1, 0.1, TABLE + 0.04)))
    world.add(toy("ball 0.03", (0.2, 0.12, TABLE + 0.031)))
    world.add(toy("box 0.09 0.03 0.05", (0.16, 0.2, TABLE + 0.08), tilted))
    world.settle()
    assert len(world.bodies()) == 3
    return world.bodies()


@pytest.mark.slow
def test_where_a_view_looks_straight_at_a_surface_the_fused_grid_agrees_and_is_never_nearer(
    world: World, settled: tuple[Body, ...]
) -> None:
    """A view measures along its ray, which meets the surface no nearer than its nearest point: in front the
    fused grid is larger, behind more negative, by 1 / cos of the angle to the normal."""
    camera = on_sphere(WORKSPACE, 0.6, np.deg2rad(20), 0.4)
    fused = fuse([world.depth_and_mask(camera)[0]], [camera], WORKSPACE)
    grid = mesh_distance(settled, world._library, WORKSPACE)
    gradient = np.stack(np.gradient(grid, VOXEL), axis=-1)
    rays = CENTRES - camera.centre
    cosine = -np.einsum("...i,...i->...", gradient, rays / np.linalg.norm(rays, axis=-1, keepdims=True))
    on_bodies = CENTRES[..., 2] > TABLE + 0.015
    front = (np.abs(grid) < 0.5) & (np.abs(fused.values) < 0.8) & (cosine > 0.9) & on_bodies
    assert front.sum() > 100
    assert np.median(np.abs(fused.values - grid)[front]) < VOXEL / 3
    half_a_pixel = 0.05 * VOXEL
    before = (grid > 0) & (fused.values > 0) & fused.observed
    behind = (grid < 0) & (fused.values < 0) & fused.observed
    for where, surplus in ((before, fused.values - grid), (behind, grid - fused.values)):
        assert where.sum() > 1000
        assert np.mean(surplus[where] > -half_a_pixel) > 0.99


@pytest.mark.slow
def test_all_views_together_see_the_same_surface(world: World, settled: tuple[Body, ...]) -> None:
    """Both change their sign at the same place, to half a voxel."""
    fused, grid = scan(world, WORKSPACE), mesh_distance(settled, world._library, WORKSPACE)
    above = (CENTRES[..., 2] > TABLE + 0.015) & fused.observed & (np.abs(grid) > VOXEL / 2)
    assert np.mean(np.sign(fused.values[above]) == np.sign(grid[above])) > 0.995
