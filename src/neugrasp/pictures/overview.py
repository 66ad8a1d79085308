"""The sheets that show one prediction: all photos with the grasps, and the surface from two sides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from neugrasp.geometry.pose import inverse
from neugrasp.geometry.view_sets import on_sphere
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.observation import Image, View, Views
from neugrasp.pictures.overlay import draw_grasps, photo_of_workspace
from neugrasp.pictures.score_scale import score_legend
from neugrasp.pictures.shading import free_where_unseen, shade_surface
from neugrasp.pictures.sheet import Tile, contact_sheet

PHOTO_SIZE = 640
"""Pixels of the longer side of a photo on the overlay sheet."""
DRAWN = 5
"""Grasps drawn into a photo; more hide the objects."""


def overlay_sheet(views: Views, grasps: Sequence[Grasp], gripper: Gripper) -> Image:
    """Every photo, cut to the workspace, with the best grasps (world frame, best first), numbered from 1, and
    what their colours mean."""
    best = list(grasps[:DRAWN])
    if best:
        scores = ", ".join(f"{number}: {grasp.score:.2f}" for number, grasp in enumerate(best, 1))
        title = f"{len(best)} best of {len(grasps)} grasps; scores {scores}"
    else:
        title = "no grasps"
    photos = [photo_of_workspace(view, views.workspace, PHOTO_SIZE) for view in views.frames]
    tiles = [Tile(draw_grasps(photo, best, gripper, 1), f"view {i}") for i, photo in enumerate(photos)]
    legend = score_legend() if best else None
    return contact_sheet(tiles, columns=2 if len(tiles) <= 4 else 4, title=title, legend=legend)


def detection_picture(
    tsdf: ArrayLike, workspace: Workspace, grasps: Sequence[Grasp], gripper: Gripper
) -> Image:
    """The surface from the side with the best grasps (world frame, best first)."""
    camera = on_sphere(workspace, 0.5, np.deg2rad(45), -0.8).moved(workspace.world_from_workspace)
    blank = np.zeros((camera.height, camera.width, 3), dtype=np.uint8)
    camera = photo_of_workspace(View(camera, blank, blank), workspace).camera
    shown = shade_surface(tsdf, workspace, camera)
    box = (-0.5, -0.5, camera.width - 0.5, camera.height - 0.5)
    camera = camera.cropped_and_resized(box, shown.shape[1], shown.shape[0])
    return draw_grasps(View(camera, shown, shown), grasps[:DRAWN], gripper, 1)


def surface_sheet(views: Views, tsdf: ArrayLike, truth: ArrayLike | None = None) -> Image:
    """The first photo beside the predicted surface from the same camera and from the opposite side, and below
    them the true surface where it is known (a fused grid, -1 where unseen)."""
    workspace = views.workspace
    front = photo_of_workspace(views.frames[0], workspace)
    back = opposite(front, workspace)

    def row(grid: ArrayLike, what: str) -> list[Tile]:
        return [
            Tile(shade_surface(grid, workspace, front.camera), f"{what} surface, same view"),
            Tile(shade_surface(grid, workspace, back.camera), f"{what} surface, other side"),
        ]

    tiles = [Tile(front.image, "photo"), *row(tsdf, "predicted")]
    if truth is not None:
        tiles += [Tile(front.background, "empty table"), *row(free_where_unseen(truth), "true")]
    return contact_sheet(tiles, columns=3)


def opposite(view: View, workspace: Workspace) -> View:
    """A blank photo of the workspace from the other side of the table, 40 degrees from the vertical."""
    place = inverse(workspace.world_from_workspace) @ view.camera.world_from_camera
    offset = place[:3, 3] - workspace.centre
    azimuth = float(np.arctan2(offset[1], offset[0])) + np.pi
    camera = on_sphere(workspace, 0.5, np.deg2rad(40), azimuth).moved(workspace.world_from_workspace)
    blank = np.zeros((camera.height, camera.width, 3), dtype=np.uint8)
    return photo_of_workspace(View(camera, blank, blank), workspace)
