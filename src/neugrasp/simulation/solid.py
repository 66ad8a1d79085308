"""How far points are from the surface of a solid made of triangles, and on which side of it they lie."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from neugrasp.geometry.pose import Array

_BLOCK = 60_000
"""Pairs of a point and a triangle that are looked at together: what a processor's cache holds."""
_ROUNDING = 1e-8
"""Metres by which a bound may be wrong."""


def signed_distance(points: Array, triangles: Array, limit: float) -> Array:
    """The Euclidean distance (n,) of points (n, 3) to triangles (f, 3, 3), + outside and - inside of the
    solid that they enclose, clipped to +-`limit`; all in metres.

    Inside is where the generalised winding number (Jacobson et al. 2013) is beyond 0.5 of either sign, so a
    mesh turned inside out is the same solid. A small hole is closed by a smooth lid, and walls that have a
    thickness enclose a cavity that stays outside, open or not. A sheet without thickness has no inside of
    its own: in an open box of single faces, those points count as inside that see less than half of all
    directions free. Where parts of one mesh overlap, a face within another part counts as surface, too.
    """
    signed = unsigned_distance(points, triangles, limit)
    within = np.flatnonzero(box_distance(points, triangles) == 0)
    inside = within[np.abs(winding_numbers(points[within], triangles)) > 0.5]
    signed[inside] *= -1
    return signed


def box_distance(points: Array, triangles: Array) -> Array:
    """The distance (n,) of points (n, 3) to the axis-aligned bounding box of triangles (f, 3, 3), 0 in it."""
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    distance: Array = np.linalg.norm(np.maximum(np.maximum(low - points, points - high), 0), axis=1)
    return distance


def winding_numbers(points: Array, triangles: Array) -> Array:
    """How often (n,) triangles (f, 3, 3), anticlockwise from outside, wind around points (n, 3): the sum of
    their solid angles (van Oosterom and Strackee 1983) over 4 pi."""
    middle = triangles.mean(axis=(0, 1))
    corners = np.moveaxis(triangles - middle, 1, 0)
    following = np.roll(corners, -1, axis=0)
    # All that the formula needs is linear in the point but for its square.
    normals = np.cross(corners, following).sum(axis=0)
    volumes = np.einsum("fi,fi->f", corners[0], np.cross(corners[1], corners[2]))
    squares, products = (corners**2).sum(axis=-1), (corners * following).sum(axis=-1)
    numbers = np.empty(len(points))
    for rows in _blocks(len(points), len(triangles)):
        p = points[rows] - middle
        p2 = (p**2).sum(axis=1)[:, None]
        a, b, c = (
            np.sqrt(np.maximum(s - 2 * p @ v.T + p2, 0)) for s, v in zip(squares, corners, strict=True)
        )
        ab, bc, ca = (d - p @ (v + w).T + p2 for d, v, w in zip(products, corners, following, strict=True))
        angles = np.arctan2(volumes - p @ normals.T, a * b * c + ab * c + bc * a + ca * b)
        numbers[rows] = angles.sum(axis=1) / (2 * np.pi)
    return numbers


def unsigned_distance(points: Array, triangles: Array, limit: float) -> Array:
    """The distance (n,) of points (n, 3) to the nearest of the triangles (f, 3, 3), at most `limit`; metres.

    Exact: only triangles that a lower bound (the distance to their plane, or to a ball around them) shows to
    be no nearer than another one are left out.
    """
    middle = triangles.mean(axis=(0, 1))
    points, triangles = points - middle, triangles - middle
    centres = triangles.mean(axis=1)
    radii = np.linalg.norm(triangles - centres[:, None], axis=2).max(axis=1)
    normals = _units(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]))
    offsets = np.einsum("fi,fi->f", normals, centres)
    nearest = np.full(len(points), limit)
    for rows in _blocks(len(points), len(triangles)):
        p = points[rows]
        squares = (centres**2).sum(axis=1) - 2 * p @ centres.T + (p**2).sum(axis=1)[:, None]
        bounds = np.sqrt(np.maximum(squares, 0)) - radii
        np.maximum(bounds, np.abs(p @ normals.T - offsets), out=bounds)
        first = _pair_distances(p, triangles[bounds.argmin(axis=1)])
        best = np.minimum(first, limit)
        which, face = np.nonzero(bounds < best[:, None] + _ROUNDING)
        np.minimum.at(best, which, _pair_distances(p[which], triangles[face]))
        nearest[rows] = best
    return nearest


def _pair_distances(points: Array, triangles: Array) -> Array:
    """The distance (k,) of each point (k, 3) to the triangle (k, 3, 3) of its own."""
    edges = np.roll(triangles, -1, axis=1) - triangles
    offsets = points[:, None] - triangles
    along = np.einsum("kei,kei->ke", offsets, edges)
    lengths = np.einsum("kei,kei->ke", edges, edges)
    share = np.clip(along / np.maximum(lengths, 1e-30), 0, 1)
    to_edges = ((offsets - share[..., None] * edges) ** 2).sum(axis=2).min(axis=1)
    normals = np.cross(edges[:, 0], edges[:, 1])
    above = np.einsum("kei,kei->ke", np.cross(normals[:, None], edges), offsets)
    heights = np.einsum("ki,ki->k", _units(normals), offsets[:, 0])
    # A triangle without area has no face: nothing lies above it, and its edges are all of it.
    squares = np.where(np.all(above > 0, axis=1), heights**2, to_edges)
    distances: Array = np.sqrt(squares)
    return distances


def _units(vectors: Array) -> Array:
    """Vectors (n, 3) at length one; those of no length stay."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30)


def _blocks(num_points: int, num_triangles: int) -> Iterator[slice]:
    size = max(1, _BLOCK // num_triangles)
    return (slice(start, start + size) for start in range(0, num_points, size))
