"""The visible surface of the bodies in a world, sampled as points with normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array
from neugrasp.geometry.view_sets import on_sphere
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.physics import World
from neugrasp.simulation.placed_meshes import placed_triangles

LOOK_SIZE = 128
"""Pixels of the square depth views that decide what is visible."""
LOOK_TOLERANCE = 0.005
"""Metres by which a point may lie behind what a view sees and still count as seen."""


@dataclass(frozen=True)
class SurfacePoints:
    """Points on visible surfaces, workspace frame."""

    points: Array
    """(n, 3), metres."""
    normals: Array
    """(n, 3), unit, outwards."""


def visible_surface(world: World, rng: np.random.Generator, count: int) -> SurfacePoints:
    """`count` points drawn uniformly by area from all surfaces, less those that no view from above sees."""
    triangles = [placed_triangles(body, world.model(body)) for body in world.bodies()]
    if not triangles:
        return SurfacePoints(np.zeros((0, 3)), np.zeros((0, 3)))
    surface = _sampled(np.concatenate(triangles), rng, count)
    seen = np.zeros(count, dtype=bool)
    for camera in looks(world.workspace):
        depth, _ = world.depth_and_mask(camera)
        seen |= _seen(camera, depth, surface)
    return SurfacePoints(surface.points[seen], surface.normals[seen])


def looks(workspace: Workspace) -> list[Camera]:
    """Six views around the table at a polar angle of 30 deg, cropped to the workspace."""
    cameras = [on_sphere(workspace, 0.6, np.deg2rad(30), np.deg2rad(60 * k)) for k in range(6)]
    return [c.cropped_and_resized(workspace.photo_box(c), LOOK_SIZE, LOOK_SIZE) for c in cameras]


def _sampled(triangles: Array, rng: np.random.Generator, count: int) -> SurfacePoints:
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    cross = np.cross(b - a, c - a)
    area = np.linalg.norm(cross, axis=1)
    chosen = rng.choice(len(area), size=count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    folded = u + v > 1
    u, v = np.where(folded, 1 - u, u), np.where(folded, 1 - v, v)
    points = a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen]
    return SurfacePoints(points, cross[chosen] / area[chosen, None])


def _seen(camera: Camera, depth: np.ndarray, surface: SurfacePoints) -> np.ndarray:
    pixels, z = camera.project(surface.points)
    u, v = np.rint(pixels).astype(int).T
    inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height) & (z > 0)
    first = depth[np.where(inside, v, 0), np.where(inside, u, 0)]
    facing = np.einsum("ij,ij->i", camera.centre - surface.points, surface.normals) > 0
    return inside & facing & (z < first + LOOK_TOLERANCE)
