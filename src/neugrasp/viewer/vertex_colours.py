"""The surface of a grid, drawn finer than its voxels, and what colours it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from neugrasp.geometry.pose import Array
from neugrasp.geometry.surface import Surface, surface_of
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import View

FINER = 2
"""Points of the drawn grid per voxel and axis."""
TABLE_TOLERANCE = 0.006
"""Metres above the table up to which a surface counts as table."""
UNSEEN = np.array([118.0, 120.0, 126.0])
"""Colour of what no photo shows."""
RAMP = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]])
"""From 0 to 1: viridis."""
GRAZING = 0.15
"""Cosine below which a photo does not count: at its outline a surface takes colours from what lies behind."""
ENOUGH = 0.01
"""Sum of visibilities from which a colour is believed; below, it fades to grey."""
STEPS = 40
"""Points of a line of sight at which the grid is asked whether it is free."""


@dataclass(frozen=True)
class Field:
    """A grid [x, y, z] in [-1, 1], read between its voxel centres."""

    grid: NDArray[np.float32]
    workspace: Workspace

    def at(self, points: Array) -> Array:
        """Values (...) at workspace points (..., 3)."""
        index = np.moveaxis(points / self.workspace.voxel_size - 0.5, -1, 0)
        values: Array = map_coordinates(self.grid, index, order=1, mode="nearest")
        return values

    def gradient(self, points: Array) -> Array:
        """Slopes (n, 3) of the distance, metres per metre: of length 1 where it is a true distance."""
        step = self.workspace.voxel_size / 2
        slopes = [(self.at(points + step * axis) - self.at(points - step * axis)) for axis in np.eye(3)]
        return np.stack(slopes, axis=-1) * (self.workspace.truncation / (2 * step))


def fine_surface(tsdf: ArrayLike, workspace: Workspace) -> Surface:
    """The zero level of a grid after cubic interpolation between its voxels."""
    return _surface(finer(tsdf), workspace)


def things_on_table(tsdf: ArrayLike, workspace: Workspace) -> Surface:
    """The part of `fine_surface` that rises from the table; its rim is drawn down to the table."""
    grid = finer(tsdf)
    height = (np.arange(grid.shape[2]) / FINER + 0.5) * workspace.voxel_size
    cut = workspace.table_height + TABLE_TOLERANCE
    above = (cut - height) / workspace.truncation
    surface = _surface(np.maximum(grid, above.astype(np.float32)), workspace)
    at_cut = surface.vertices[:, 2] < cut + 1e-4
    surface = compact(surface, ~at_cut[surface.faces].all(axis=1))
    vertices = surface.vertices.copy()
    vertices[vertices[:, 2] < cut + 1e-4, 2] = workspace.table_height
    return Surface(vertices, surface.faces)


def finer(tsdf: ArrayLike) -> NDArray[np.float32]:
    """The grid [x, y, z] read `FINER` times between two voxel centres by cubic interpolation."""
    grid = np.asarray(tsdf, dtype=np.float32)
    places = [np.arange((n - 1) * FINER + 1) / FINER for n in grid.shape]
    fine = map_coordinates(grid, np.meshgrid(*places, indexing="ij"), order=3, mode="nearest")
    return np.asarray(fine, dtype=np.float32)


def _surface(fine: NDArray[np.float32], workspace: Workspace) -> Surface:
    surface = surface_of(fine, workspace)
    index = surface.vertices / workspace.voxel_size - 0.5
    return Surface(workspace.position_of(index / FINER), surface.faces)


def compact(surface: Surface, chosen: NDArray[np.bool_]) -> Surface:
    """The chosen faces, with the vertices that they use."""
    used, faces = np.unique(surface.faces[chosen], return_inverse=True)
    return Surface(surface.vertices[used], faces.reshape(-1, 3).astype(np.int32))


def by_photos(surface: Surface, field: Field, views: Sequence[View]) -> NDArray[np.uint8]:
    """(n, 3): every vertex as the photos that see it show it, most those that it faces; grey without any."""
    weights = visibility(surface, field, views)
    total = weights.sum(axis=0)
    colours = np.zeros((len(surface.vertices), 3))
    for view, weight in zip(views, weights, strict=True):
        pixels, _ = view.camera.project(surface.vertices)
        places = (pixels[:, 1], pixels[:, 0])
        seen = [map_coordinates(view.image[..., c].astype(float), places, order=1) for c in range(3)]
        colours += weight[:, None] * np.stack(seen, axis=-1)
    shown = colours / np.maximum(total, 1e-9)[:, None]
    trust = (total / ENOUGH).clip(0, 1)[:, None]
    return (trust * shown + (1 - trust) * UNSEEN).round().clip(0, 255).astype(np.uint8)


def by_confidence(surface: Surface, field: Field) -> NDArray[np.uint8]:
    """(n, 3): how steeply the predicted distance falls through the surface: 1 (yellow) is a sharp surface, as
    of a true distance; 0 (violet) a guess smeared over many voxels."""
    return ramp(np.linalg.norm(field.gradient(surface.vertices), axis=-1))


def by_views(surface: Surface, field: Field, views: Sequence[View]) -> NDArray[np.uint8]:
    """(n, 3): the share of the cameras that see each vertex, from violet for none to yellow for all."""
    return ramp((visibility(surface, field, views) > 0).mean(axis=0))


def visibility(surface: Surface, field: Field, views: Sequence[View]) -> Array:
    """(views, n): 0 where a vertex is hidden from a camera or outside its photo, else the fourth power of the
    cosine under which it is seen."""
    normals = field.gradient(surface.vertices)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
    rows = []
    for view in views:
        pixels, depth = view.camera.project(surface.vertices)
        left, top, right, bottom = view.camera.bounds
        inside = (pixels >= (left, top)).all(axis=-1) & (pixels <= (right, bottom)).all(axis=-1) & (depth > 0)
        line = view.camera.centre - surface.vertices
        direction = line / np.linalg.norm(line, axis=-1, keepdims=True)
        facing = (normals * direction).sum(axis=-1)
        free = is_free(surface.vertices + field.workspace.voxel_size * normals, direction, field)
        rows.append(np.where(inside & free & (facing > GRAZING), facing.clip(0, 1) ** 4, 0.0))
    return np.array(rows).reshape(len(views), len(surface.vertices))


def is_free(points: Array, directions: Array, field: Field) -> NDArray[np.bool_]:
    """Whether the lines from points (n, 3) along directions leave the cube without touching matter."""
    distances = np.linspace(0, field.workspace.size * np.sqrt(3), STEPS)[:, None, None]
    along = points + distances * directions
    values = np.where(field.workspace.contains(along), field.at(along), 1.0)
    return np.asarray((values > -0.05).all(axis=0))


def ramp(values: ArrayLike) -> NDArray[np.uint8]:
    """Colours (n, 3) of numbers (n,); what is beyond 0 and 1 gets the colour of the end."""
    place = np.clip(np.asarray(values, dtype=float), 0, 1)
    known = np.linspace(0, 1, len(RAMP))
    return np.stack([np.interp(place, known, RAMP[:, c]) for c in range(3)], axis=-1).round().astype(np.uint8)
