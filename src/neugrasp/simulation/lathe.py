"""Surfaces of revolution: closed smooth meshes to look at, convex wedges to touch, hollow where hollow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from neugrasp.geometry.pose import Array
from neugrasp.simulation.meshes import Mesh

NUM_SECTORS = 10
"""Wedges around the axis in the collision shape."""


@dataclass(frozen=True)
class Vessel:
    """A hollow body about the z axis, open at the top. Metres."""

    base: tuple[tuple[float, float], ...]
    """(radius, z) of the solid part from the table up to the floor of the hollow."""
    radius: Callable[[Array], Array]
    """Outer radius of the wall at heights z."""
    floor: float
    """Height at which the hollow begins."""
    height: float
    wall: float
    """Thickness of the wall, measured across it."""
    breaks: tuple[float, ...] = ()
    """Heights that the segments of the collision shape must not straddle."""
    segments: int = 2
    """Segments of the collision shape where there are no `breaks`."""

    def outer_and_inner(self, z: Array) -> tuple[Array, Array]:
        """Radii of both sides of the wall: on a slope it is wider across than it is thick."""
        step = 1e-5
        slope = (self.radius(z + step) - self.radius(z - step)) / (2 * step)
        outer = self.radius(z)
        inner: Array = np.maximum(outer - self.wall * np.sqrt(1 + np.minimum(slope**2, 8.0)), 0.001)
        return outer, inner


def surface(vessel: Vessel, num_heights: int = 24) -> Mesh:
    """The closed surface of a vessel, rim rounded."""
    z = np.linspace(vessel.floor, vessel.height, num_heights)
    outer, inner = vessel.outer_and_inner(z)
    angles = np.linspace(0, np.pi, 6)[1:-1]
    middle, half = (outer[-1] + inner[-1]) / 2, (outer[-1] - inner[-1]) / 2
    rim = np.stack([middle + half * np.cos(angles), vessel.height + half * np.sin(angles)], axis=1)
    profile = [
        np.array([(0.0, 0.0), *vessel.base]),
        np.stack([outer, z], axis=1),
        rim,
        np.stack([inner, z], axis=1)[::-1],
        np.array([(0.0, vessel.floor)]),
    ]
    return revolved(np.concatenate(profile))


def revolved(profile: Array, num_sides: int = 64) -> Mesh:
    """A profile (k, 2) of (radius, z), from the axis at the bottom around to the axis, turned about z."""
    angles = 2 * np.pi * np.arange(num_sides) / num_sides
    ring = profile[1:-1]
    x, y = ring[:, :1] * np.cos(angles), ring[:, :1] * np.sin(angles)
    z = np.broadcast_to(ring[:, 1:], x.shape)
    poles = np.array([[0, 0, profile[0, 1]], [0, 0, profile[-1, 1]]])
    vertices = np.concatenate([np.stack([x, y, z], axis=-1).reshape(-1, 3), poles])
    here = np.arange(len(ring) * num_sides).reshape(len(ring), num_sides)
    there = np.roll(here, -1, axis=1)
    a, b, c, d = (grid.reshape(-1) for grid in (here[:-1], there[:-1], there[1:], here[1:]))
    bottom, top = len(vertices) - 2, len(vertices) - 1
    faces = [
        np.stack([a, b, c], axis=1),
        np.stack([a, c, d], axis=1),
        np.stack([np.full(num_sides, bottom), there[0], here[0]], axis=1),
        np.stack([np.full(num_sides, top), here[-1], there[-1]], axis=1),
    ]
    return Mesh(vertices, np.concatenate(faces))


def convex_parts(vessel: Vessel) -> tuple[Mesh, ...]:
    """The solid base as slices and the wall as wedges, each convex; the hollow stays empty."""
    heights = _segment_heights(vessel)
    outer, inner = vessel.outer_and_inner(heights)
    base = [*vessel.base, (float(outer[0]), float(heights[0]))]
    parts = [
        revolved(np.array([(0, low[1]), low, high, (0, high[1])]), 16)
        for low, high in pairwise(base)
        if high[1] > low[1]
    ]
    # A wedge's flat faces cut the corners of the circle; half of the loss is made up outside.
    spread = 2 / (1 + np.cos(np.pi / NUM_SECTORS))
    for k in range(len(heights) - 1):
        corners = [(inner[k], heights[k]), (outer[k], heights[k])]
        corners += [(outer[k + 1], heights[k + 1]), (inner[k + 1], heights[k + 1])]
        section = np.array(corners) * (spread, 1.0)
        parts += [_wedge(section, sector) for sector in range(NUM_SECTORS)]
    return tuple(parts)


def _segment_heights(vessel: Vessel) -> Array:
    if not vessel.breaks:
        return np.linspace(vessel.floor, vessel.height, vessel.segments + 1)
    start, end = vessel.breaks
    return np.array([vessel.floor, start, (start + end) / 2, end, vessel.height])


def _wedge(section: Array, sector: int) -> Mesh:
    angles = 2 * np.pi * (sector + np.arange(2)) / NUM_SECTORS
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    flat = section[None, :, :1] * directions[:, None]
    height = np.broadcast_to(section[None, :, 1:], (2, 4, 1))
    vertices = np.concatenate([flat, height], axis=-1).reshape(8, 3)
    quads = [(0, 1, 2, 3), (7, 6, 5, 4), (1, 5, 6, 2), (4, 0, 3, 7), (3, 2, 6, 7), (0, 4, 5, 1)]
    return Mesh(vertices, np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]))


def box(half_extents: Array) -> Mesh:
    """A box that stands on z = 0 about the z axis."""
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    low = np.column_stack([signs * half_extents[:2], np.zeros(4)])
    vertices = np.concatenate([low, low + np.array([0, 0, 2 * half_extents[2]])])
    quads = [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    return Mesh(vertices, np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]))
