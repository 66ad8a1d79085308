"""From where the photos are taken, and the way of the hand to a grasp and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from neugrasp.detection.contract import Detection
from neugrasp.detection.explanation import explain
from neugrasp.figures.figure_inputs import FigureInput
from neugrasp.figures.space import OVERSAMPLING, Canvas, Colour
from neugrasp.figures.sphere import eye_that_sees, from_spherical, spherical, way_between
from neugrasp.geometry.pose import Array, apply, inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import APPROACH, Grasp
from neugrasp.gripper import Gripper
from neugrasp.observation import Image, View
from neugrasp.pictures import Tile, contact_sheet, photo_of_workspace, shade_surface

SIZE = (620, 560)
"""Width and height of a picture."""
PATH, BAND, DOME, EDGE = (235, 110, 30), (90, 130, 220), (150, 156, 168), (50, 50, 60)
BEFORE, AT, AFTER = (50, 110, 230), (40, 170, 70), (225, 80, 40)
PAPER_POLAR = np.deg2rad([15.0, 22.5])
PAPER_AZIMUTH = np.deg2rad(60.0)
PAPER_RADIUS = 0.45
"""The paper's viewpoints: polar angles, their range of azimuths (a sixth of a turn), mean radius."""
LABEL = np.array([0.0, 0.0, 0.035])
"""From a camera to its number, metres."""
PHOTO_DEPTH = 0.11
"""Metres from a camera to its drawn photo."""
ASIDE, POLAR = np.deg2rad(62.0), np.deg2rad(66.0)
"""From where the cameras are seen: azimuth from their middle, polar angle."""
HAND_POLARS = np.deg2rad([50.0, 70.0])
"""From where the hand may be seen."""
FRONT = 0.2
"""How much it counts, against seeing the hand's full face, that it is seen from the side of the cameras."""


def trajectory_figure(source: FigureInput, detection: Detection, gripper: Gripper) -> Image:
    """Left: the cameras with their photos on the way between them, over the surface. Right: the hand before
    the best grasp, at it, and after its retreat."""
    here = replace(source.views.workspace, world_from_workspace=np.eye(4))
    from_world = inverse(source.views.workspace.world_from_workspace)
    photos = [photo_of_workspace(view, source.views.workspace, 300) for view in source.views.frames]
    photos = [replace(photo, camera=photo.camera.moved(from_world)) for photo in photos]
    places = spherical(np.array([photo.camera.centre for photo in photos]), here)
    polar, azimuth = np.rad2deg(places[:, :2]).T
    words = (
        f"{len(places)} photos over {np.ptp(azimuth):.0f}°, polar angle {polar[0]:.0f}° to {polar[-1]:.0f}°; "
        "blue: the paper's 15° to 22.5°"
    )
    tiles = [Tile(cameras_picture(photos, detection, here), words)]
    if detection.grasps:
        picture = hand_picture(detection, gripper, here, from_world, toward=float(places[:, 1].mean()))
        way = f"hand {100 * APPROACH:.0f} cm before the best grasp (blue), at it (green), after retreat (red)"
        tiles.append(Tile(picture, way))
    else:
        blank = np.full((SIZE[1], SIZE[0], 3), 255, dtype=np.uint8)
        tiles.append(Tile(blank, f"no grasp: {explain(detection)}"))
    return contact_sheet(tiles, columns=2, title=f"{source.name}: the way of the camera and of the hand")


def cameras_picture(photos: list[View], detection: Detection, workspace: Workspace) -> Image:
    """The surface, the paper's part of the hemisphere, the cameras' way, their photos (workspace frame)."""
    centres = np.array([photo.camera.centre for photo in photos])
    azimuth = float(spherical(centres, workspace)[:, 1].mean())
    shown = [workspace.corners(workspace.table_height, workspace.table_height + 0.1)]
    shown += [centres + LABEL, *_dome(workspace, azimuth)]
    shown += [corners(photo) for photo in photos]
    eye = eye_that_sees(np.concatenate(shown), workspace, POLAR, azimuth + ASIDE, SIZE)
    canvas = Canvas(shade_surface(detection.grid(), workspace, eye, OVERSAMPLING * max(SIZE)), eye)
    for line in _dome(workspace, azimuth):
        canvas.line(line, DOME, 1, 0.8)
    band = _band(workspace, azimuth)
    canvas.face(band, BAND, 0.30)
    canvas.line(np.concatenate([band, band[:1]]), BAND, 1.5)
    for index in np.argsort(-np.linalg.norm(centres - eye.centre, axis=1)):
        _draw_camera(canvas, photos[index])
    canvas.line(way_between(centres, workspace), PATH, 3)
    for index, centre in enumerate(centres):
        canvas.line(np.stack([centre, centre]), PATH, 10)
        canvas.words(str(index), centre + LABEL, PATH, 17)
    return canvas.image()


def hand_picture(
    detection: Detection, gripper: Gripper, workspace: Workspace, from_world: Array, toward: float
) -> Image:
    """The surface with the hand on its way to the best grasp: open before it, closed at it, and afterwards.

    Seen from where both fingers show, if it can be from the side of azimuth `toward`, radians.
    """
    grasp = detection.grasps[0].moved(from_world)
    stages = hand_stages(grasp, gripper)
    wires = [apply(stage.pose, gripper.wireframe(stage.width)) for stage, _ in stages]
    polar, azimuth = _best_side(grasp.pose[:3, 0], toward)
    cube = workspace.corners(workspace.table_height, workspace.table_height + 0.05)
    shown = np.concatenate([cube, *(wire.reshape(-1, 3) for wire in wires)])
    eye = eye_that_sees(shown, workspace, polar, azimuth, SIZE)
    canvas = Canvas(shade_surface(detection.grid(), workspace, eye, OVERSAMPLING * max(SIZE)), eye)
    tcp = [stage.position for stage, _ in stages]
    canvas.line(np.stack([tcp[0], tcp[2]]), BEFORE, 2, 0.9)
    canvas.line(np.stack([tcp[2], tcp[1]]), AFTER, 2, 0.9)
    for (_, colour), wire in zip(stages, wires, strict=True):
        for thickness, ink in ((8.0, (20, 20, 20)), (5.0, colour)):
            for segment in wire:
                canvas.line(segment, ink, thickness)
    return canvas.image()


def hand_stages(grasp: Grasp, gripper: Gripper) -> list[tuple[Grasp, Colour]]:
    """The hand open before the grasp, after the retreat, and at it, as `robot.pick` leads it."""
    before = replace(grasp, pose=grasp.pregrasp, width=gripper.max_opening)
    after = replace(grasp, pose=replace(grasp, up=(0.0, 0.0, 1.0)).retreat)
    return [(before, BEFORE), (after, AFTER), (grasp, AT)]


def _best_side(flat: Array, toward: float) -> tuple[float, float]:
    """Polar angle and azimuth from which one sees most of the hand, whose plane has the normal `flat`."""

    def merit(side: tuple[float, float]) -> float:
        polar, azimuth = side
        ring = np.sin(polar)
        direction = np.array([ring * np.cos(azimuth), ring * np.sin(azimuth), np.cos(polar)])
        return float(np.abs(direction @ flat) + FRONT * np.cos(azimuth - toward))

    azimuths = np.linspace(0, 2 * np.pi, 36, endpoint=False).tolist()
    return max(((polar, azimuth) for polar in HAND_POLARS.tolist() for azimuth in azimuths), key=merit)


def corners(photo: View) -> Array:
    """The corners (4, 3) of a photo held before its camera, from the upper left clockwise."""
    right, bottom = photo.camera.width - 0.5, photo.camera.height - 0.5
    pixels = np.array([(-0.5, -0.5), (right, -0.5), (right, bottom), (-0.5, bottom)])
    return photo.camera.unproject(pixels, np.full(4, PHOTO_DEPTH))


def _draw_camera(canvas: Canvas, photo: View) -> None:
    frame = corners(photo)
    for corner in frame:
        canvas.line(np.stack([photo.camera.centre, corner]), EDGE, 1.2)
    canvas.photo(photo.image, frame)
    canvas.line(np.concatenate([frame, frame[:1]]), EDGE, 1.6)


def _dome(workspace: Workspace, azimuth: float) -> list[Array]:
    """Meridians and parallels of the sixth of the hemisphere about `azimuth`, down to 60 degrees."""
    azimuths = azimuth + np.linspace(-0.5, 0.5, 25) * PAPER_AZIMUTH
    polars = np.deg2rad(np.linspace(0, 60, 31))
    lines = [_on_dome(polars, around, workspace) for around in azimuths[::6]]
    return lines + [_on_dome(polar, azimuths, workspace) for polar in np.deg2rad([30, 60])]


def _band(workspace: Workspace, azimuth: float) -> Array:
    """The outline (n, 3) of the paper's viewpoints."""
    azimuths = azimuth + np.linspace(-0.5, 0.5, 25) * PAPER_AZIMUTH
    low, high = PAPER_POLAR
    return np.concatenate([_on_dome(low, azimuths, workspace), _on_dome(high, azimuths[::-1], workspace)])


def _on_dome(polar: Array | float, azimuth: Array | float, workspace: Workspace) -> Array:
    places = np.stack(np.broadcast_arrays(polar, azimuth, PAPER_RADIUS), axis=-1)
    return from_spherical(np.atleast_2d(places), workspace)
