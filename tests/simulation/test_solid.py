"""Distances to solids of triangles: those of closed forms, exact, and of the right sign."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from neugrasp.geometry.pose import Array, apply, from_quaternion
from neugrasp.simulation.solid import (
    _pair_distances,
    box_distance,
    signed_distance,
    unsigned_distance,
    winding_numbers,
)

LIMIT = 0.03
FACETS = 1e-4
"""Metres by which the finest ball here is flatter than a sphere."""


def corners(mesh: trimesh.Trimesh) -> Array:
    return np.array(mesh.vertices, dtype=np.float64)[np.array(mesh.faces)]


def ball(radius: float) -> Array:
    return corners(trimesh.creation.icosphere(4, radius))


def block(*edges: float) -> Array:
    return corners(trimesh.creation.box(edges))


def cup(radius: float, height: float, wall: float) -> Array:
    """Open above, its bottom at z = 0, walls and bottom of one thickness."""
    inner = radius - wall
    profile = [(0, 0), (radius, 0), (radius, height), (inner, height), (inner, wall), (0, wall)]
    mesh = trimesh.creation.revolve(profile, sections=128)
    assert mesh.is_watertight
    return corners(mesh)


def around(triangles: Array, count: int = 3000, margin: float = 0.035) -> Array:
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    return np.random.default_rng(0).uniform(low - margin, high + margin, (count, 3))


def block_formula(points: Array, edges: Array) -> Array:
    beyond = np.abs(points) - edges / 2
    return np.linalg.norm(np.maximum(beyond, 0), axis=-1) + np.minimum(beyond.max(axis=-1), 0)


def test_a_ball_is_a_sphere_but_for_its_facets() -> None:
    points = around(ball(0.04))
    expected = np.clip(np.linalg.norm(points, axis=1) - 0.04, -LIMIT, LIMIT)
    np.testing.assert_allclose(signed_distance(points, ball(0.04), LIMIT), expected, atol=FACETS)


@pytest.mark.parametrize("edges", [(0.04, 0.05, 0.06), (0.2, 0.002, 0.01), (0.1, 0.1, 0.1)])
def test_a_box_is_as_its_formula_says(edges: tuple[float, float, float]) -> None:
    points = around(block(*edges))
    expected = np.clip(block_formula(points, np.array(edges)), -LIMIT, LIMIT)
    np.testing.assert_allclose(signed_distance(points, block(*edges), LIMIT), expected, atol=1e-9)


def test_what_is_left_out_is_never_nearer() -> None:
    """A heap of triangles of all shapes, slivers, points and lines among them."""
    rng = np.random.default_rng(1)
    heap = rng.uniform(-0.05, 0.05, (60, 1, 3)) + rng.normal(0, 0.02, (60, 3, 3)) * rng.random((60, 1, 1))
    heap[:5, 2] = heap[:5, 1] + 1e-6
    heap[5:8] = heap[5:8, :1]
    heap[8:10, 2] = heap[8:10, :2].mean(axis=1)
    points = around(heap, 500)
    pairs = [_pair_distances(points, np.broadcast_to(one, (len(points), 3, 3))) for one in heap]
    expected = np.minimum(np.min(pairs, axis=0), LIMIT)
    np.testing.assert_allclose(unsigned_distance(points, heap, LIMIT), expected, atol=1e-12)


@pytest.mark.slow
def test_no_point_of_a_triangle_is_nearer_than_its_distance_says_and_one_is_as_near() -> None:
    rng = np.random.default_rng(2)
    a, b, c = rng.uniform(-1, 1, (3, 3))
    u, v = np.meshgrid(np.linspace(0, 1, 401), np.linspace(0, 1, 401))
    keep = u + v <= 1
    u, v = u[keep][:, None], v[keep][:, None]
    covered = a + u * (b - a) + v * (c - a)
    points = rng.uniform(-2, 2, (50, 3))
    nearest = np.linalg.norm(points[:, None] - covered, axis=2).min(axis=1)
    distances = _pair_distances(points, np.broadcast_to(np.stack([a, b, c]), (50, 3, 3)))
    assert np.all(distances <= nearest + 1e-12)
    np.testing.assert_allclose(distances, nearest, atol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("triangles", [ball(0.04), block(0.05, 0.06, 0.07)], ids=["ball", "box"])
def test_the_gradient_has_length_one_away_from_the_medial_axis(triangles: Array) -> None:
    step, points = 1e-6, around(triangles, 1000, 0.02)
    # Outside both are convex and have no medial axis; within 1 cm of the surface it is far inside.
    there = signed_distance(points, triangles, LIMIT)
    depth = block_formula(points, np.ptp(triangles, axis=(0, 1)))
    second = np.sort(np.abs(np.abs(points) - np.ptp(triangles, axis=(0, 1)) / 2), axis=1)
    clear = (there < 0.9 * LIMIT) & ((depth > 0) | (second[:, 1] - second[:, 0] > 1e-3)) & (there > -0.02)
    steps = step * np.eye(3)
    ahead, back = (
        np.stack([signed_distance(points + s * d, triangles, LIMIT) for d in steps], axis=1) for s in (1, -1)
    )
    lengths = np.linalg.norm((ahead - back) / (2 * step), axis=1)[clear]
    assert len(lengths) > 200
    # A facet's plane is met at an angle only where two facets are equally near.
    assert np.mean(np.abs(lengths - 1) < 1e-4) > 0.99


@pytest.mark.slow
def test_moving_solid_and_points_together_changes_nothing() -> None:
    world_from_mesh = from_quaternion((0.1, -0.5, 0.3, 0.8), (0.15, 0.2, 0.1))
    for triangles in (ball(0.03), cup(0.04, 0.08, 0.004)):
        points = around(triangles)
        moved = signed_distance(apply(world_from_mesh, points), apply(world_from_mesh, triangles), LIMIT)
        np.testing.assert_allclose(moved, signed_distance(points, triangles, LIMIT), atol=1e-9)


@pytest.mark.slow
def test_an_open_cup_is_hollow() -> None:
    radius, height, wall = 0.04, 0.08, 0.004
    triangles = cup(radius, height, wall)
    points = around(triangles, 6000)
    r, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    found = signed_distance(points, triangles, LIMIT)
    in_cavity = (r < radius - wall - FACETS) & (z > wall) & (z < height)
    in_wall = (r < radius - FACETS) & (z > 0) & (z < height) & ((r > radius - wall) | (z < wall))
    assert np.all(found[in_cavity] > 0)
    assert np.all(found[in_wall] < 0)
    assert in_cavity.sum() > 100
    assert in_wall.sum() > 100
    expected = np.minimum(np.minimum(radius - wall - r, z - wall), LIMIT)[in_cavity & (z < height / 2)]
    np.testing.assert_allclose(found[in_cavity & (z < height / 2)], expected, atol=FACETS)


def test_a_closed_cavity_is_outside() -> None:
    shell = np.concatenate([block(0.08, 0.08, 0.08), block(0.06, 0.06, 0.06)[:, ::-1]])
    found = signed_distance(np.array([[0.0, 0, 0], [0.035, 0, 0], [0.05, 0, 0]]), shell, 1.0)
    np.testing.assert_allclose(found, [0.03, -0.005, 0.01], atol=1e-12)


@pytest.mark.slow
def test_a_mesh_turned_inside_out_is_the_same_solid() -> None:
    points, triangles = around(ball(0.03)), ball(0.03)
    there = signed_distance(points, triangles, LIMIT)
    np.testing.assert_array_equal(np.sign(signed_distance(points, triangles[:, ::-1], LIMIT)), np.sign(there))
    assert np.any(there < 0)


def test_winding_numbers_count() -> None:
    twice = np.concatenate([block(0.08, 0.08, 0.08), block(0.06, 0.06, 0.06)])
    points = np.array([[0.0, 0, 0], [0.035, 0, 0], [0.05, 0, 0]])
    np.testing.assert_allclose(winding_numbers(points, twice), [2, 1, 0], atol=1e-12)


@pytest.mark.slow
def test_a_small_hole_is_closed_and_a_missing_lid_opens_a_box_where_half_of_all_is_free() -> None:
    holed = ball(0.03)[1:]
    points = around(holed)
    np.testing.assert_array_equal(
        np.sign(signed_distance(points, holed, LIMIT)), np.sign(signed_distance(points, ball(0.03), LIMIT))
    )
    box = block(0.06, 0.06, 0.06)
    sheet = box[~np.all(box[:, :, 2] > 0, axis=1)]
    assert len(sheet) == 10
    # In the plane of the opening half of all directions are free, and deeper fewer.
    found = signed_distance(np.array([[0, 0, 0.0299], [0, 0, 0.0301], [0, 0, -0.02]]), sheet, 1.0)
    np.testing.assert_array_equal(np.sign(found), [-1, 1, -1])


@pytest.mark.slow
def test_the_distance_to_a_box_around_triangles_is_never_more_than_that_to_them() -> None:
    triangles = ball(0.03)
    points = around(triangles)
    outer = box_distance(points, triangles)
    assert np.all(outer <= unsigned_distance(points, triangles, 1.0) + 1e-12)
    np.testing.assert_allclose(outer, np.maximum(block_formula(points, np.full(3, 0.06)), 0), atol=1e-12)
