"""Surface, cameras and grasps as numbers that a page can turn and draw without any library."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from importlib import resources

import numpy as np
from numpy.typing import ArrayLike

from neugrasp.geometry.pose import Array, apply, inverse
from neugrasp.geometry.surface import Surface, surface_of
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.observation import View, Views
from neugrasp.pictures.score_scale import colour_of_score

MOST_GRASPS = 30
"""Wireframes in the picture; the best ones."""
FRUSTUM = 0.06
"""Length in metres of the pyramid that stands for a camera."""


def scene_3d(views: Views, tsdf: ArrayLike, grasps: Sequence[Grasp], gripper: Gripper) -> str:
    """A canvas that can be turned with the mouse, as HTML; everything in the workspace frame."""
    workspace = views.workspace
    workspace_from_world = inverse(workspace.world_from_workspace)
    surface = surface_of(tsdf, workspace)
    data = {
        "vertices": _packed(surface.vertices, "<f4"),
        "faces": _packed(surface.faces, "<u4"),
        "colours": _packed(_colours(surface, views), "u1"),
        "cube": _edges(workspace).tolist(),
        "cameras": [_frustum(view, workspace_from_world).round(4).tolist() for view in views.frames],
        "grasps": [
            {
                "lines": apply(workspace_from_world @ grasp.pose, gripper.wireframe(grasp.width))
                .round(4)
                .tolist(),
                "number": number,
                "colour": "rgb({}, {}, {})".format(*colour_of_score(grasp.score)),
            }
            for number, grasp in enumerate(grasps[:MOST_GRASPS], 1)
        ],
        "azimuth": _azimuth(views, workspace_from_world),
        "centre": [workspace.size / 2, workspace.size / 2, workspace.table_height + 0.03],
    }
    script = (resources.files("neugrasp.report") / "scene_3d.js").read_text(encoding="utf-8")
    return (
        '<canvas id="scene" style="width:100%;height:520px;cursor:grab;touch-action:none"></canvas>\n'
        "<p class='remedy'>Drag to rotate, scroll to zoom, click a row of the table for one grasp.</p>\n"
        f'<script id="scene-data" type="application/json">{json.dumps(data)}</script>\n'
        f"<script>\n{script}</script>"
    )


def _azimuth(views: Views, workspace_from_world: Array) -> float:
    """A direction, radians, beside that from which the cameras look."""
    centres = [apply(workspace_from_world, view.camera.centre) for view in views.frames]
    x, y = (np.mean(centres, axis=0) - views.workspace.centre)[:2]
    return float(np.arctan2(y, x)) + 0.5


def _packed(array: Array | np.ndarray, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype=kind).tobytes()).decode("ascii")


def _colours(surface: Surface, views: Views) -> np.ndarray:
    """(m, 3) uint8: each face as the photo that looks at it most directly shows it, hidden or not."""
    if len(surface.faces) == 0:
        return np.zeros((0, 3), dtype=np.uint8)
    corners = surface.vertices[surface.faces]
    middle = corners.mean(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    best, colours = np.full(len(middle), -np.inf), np.full((len(middle), 3), 150.0)
    for view in views.frames:
        camera = view.camera.moved(inverse(views.workspace.world_from_workspace))
        pixels, depth = camera.project(middle)
        column, row = pixels.round().astype(int).T
        left, top, right, bottom = camera.bounds
        seen = (depth > 0) & (column >= left) & (column <= right) & (row >= top) & (row <= bottom)
        line = camera.centre - middle
        facing = np.where(seen, (normal * line).sum(-1) / np.linalg.norm(line, axis=-1), -np.inf)
        nearer = facing > best
        colours[nearer] = view.image[row[nearer], column[nearer]]
        best = np.maximum(best, facing)
    return colours.round().astype(np.uint8)


def _edges(workspace: Workspace) -> Array:
    """(12, 2, 3): the edges of the cube."""
    corners = workspace.corners()
    pairs = [(a, b) for i, a in enumerate(corners) for b in corners[i + 1 :]]
    return np.array([(a, b) for a, b in pairs if np.count_nonzero(a != b) == 1])


def _frustum(view: View, workspace_from_world: Array) -> Array:
    """(8, 2, 3): the pyramid of a camera as segments."""
    camera = view.camera.moved(workspace_from_world)
    left, top, right, bottom = camera.bounds
    corners = camera.unproject([(left, top), (right, top), (right, bottom), (left, bottom)], [FRUSTUM] * 4)
    sides = [(camera.centre, corner) for corner in corners]
    return np.array(sides + [(corners[i], corners[(i + 1) % 4]) for i in range(4)])
