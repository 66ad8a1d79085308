"""From data and settings to what is drawn. Parts that did not change come back as the same objects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from neugrasp.detection.options import Box
from neugrasp.geometry.pose import Array, apply, inverse, rigid
from neugrasp.geometry.surface import Surface
from neugrasp.gripper import Gripper
from neugrasp.pictures.score_scale import colour_of_outcome, colour_of_score
from neugrasp.pictures.slices import slice_picture
from neugrasp.viewer.cameras import cameras
from neugrasp.viewer.hand_meshes import bar_mesh, finger_mesh, hand_mesh
from neugrasp.viewer.primitives import AxesNode, LabelNode, LinesNode, MeshNode, Node, PictureNode
from neugrasp.viewer.scene_data import Colour, GraspMarker, Grid, SceneData, Snapshot
from neugrasp.viewer.settings import Colouring, Hand, Settings
from neugrasp.viewer.table_texture import edge, tabletop
from neugrasp.viewer.vertex_colours import (
    Field,
    by_confidence,
    by_photos,
    by_views,
    fine_surface,
    things_on_table,
)

CUBE: Colour = (150, 156, 166)
PLAIN: Colour = (120, 165, 215)
CHOSEN: Colour = (30, 90, 200)
"""Colour of the region of a chosen object."""
TRUE: Colour = (64, 190, 170)
"""Colour of true surfaces and grasps."""
BELOW_TABLE = 0.0008
"""Metres by which the picture of the table lies below the table, so that bodies stand on it."""
SLICE_PIXELS = 320


HAND_MESHES: dict[Hand, Callable[[Gripper, float], Surface]] = {
    "whole hand": hand_mesh,
    "fingers": finger_mesh,
    "lines": bar_mesh,
}


def nodes_of(data: SceneData, settings: Settings) -> tuple[Node, ...]:
    """Everything that is to be drawn, names unique."""
    moment = data.moment(settings.moment)
    nodes: list[Node] = []
    if settings.shows_table:
        nodes.append(_table(data))
    if settings.shows_cube:
        nodes.append(_cube(data))
    if settings.shows_cameras:
        nodes += cameras(data)
    if settings.shows_surface and moment.tsdf is not None:
        nodes.append(_surface(data, moment, settings.colouring, settings.shows_reconstructed_table))
    nodes += _solids(moment)
    if settings.shows_truth:
        nodes += _truth(data)
    if settings.shows_true_grasps:
        nodes += true_grasps_of(data, settings)
    chosen = settings.selected
    hands = grasps_of(data, settings)
    nodes += [_seen_through(node) if node.marker is chosen else node for node in hands]
    shown = [node.marker for node in hands if node.marker is not None]
    nodes += [_number(data, marker) for marker in shown if marker.number is not None]
    if settings.region is not None:
        nodes.append(_region(data, settings.region))
    if settings.slice_axis != "none" and moment.tsdf is not None:
        nodes.append(_slice(data, moment, "xyz".index(settings.slice_axis), settings.slice_index))
    if chosen is not None:
        nodes.append(AxesNode("selected", chosen.grasp.pose, 0.07))
    return tuple(nodes)


def grasps_of(data: SceneData, settings: Settings) -> tuple[MeshNode, ...]:
    """The grasps at or above the threshold, best first, as many as wanted."""
    moment = data.moment(settings.moment)
    hands = _hands(data, moment.grasps, settings.hand, "grasps")
    passed = [node for node in hands if _score(node) >= settings.threshold]
    if settings.region is not None:
        passed = [node for node in passed if _is_in(settings.region, node.marker, data)]
    return tuple(passed[: settings.most])


@lru_cache(maxsize=256)
def _number(data: SceneData, marker: GraspMarker) -> LabelNode:
    """The number of a grasp where the arm would be."""
    start = data.gripper.wireframe(marker.grasp.width)[-1, 0]
    return LabelNode(f"numbers/{marker.number}", str(marker.number), apply(marker.grasp.pose, start))


def true_grasps_of(data: SceneData, settings: Settings) -> tuple[MeshNode, ...]:
    """As many of the grasps that held as wanted, spread over all of them."""
    hands = _hands(data, data.truth.grasps, settings.hand, "truth/grasps")
    chosen = np.linspace(0, len(hands) - 1, min(settings.most, len(hands))).round().astype(int)
    return tuple(hands[i] for i in chosen)


def colour_of(marker: GraspMarker) -> Colour:
    """Green for a grasp that held, red for one that did not; else by its score, red to yellow to green."""
    if marker.outcome is not None:
        return colour_of_outcome(marker.outcome)
    return colour_of_score(marker.grasp.score)


def describe(data: SceneData, marker: GraspMarker) -> str:
    """What a click on a grasp shows, as Markdown."""
    in_world = marker.grasp.moved(data.workspace.world_from_workspace)
    place, approach = (" ".join(f"{x:+.3f}" for x in v) for v in (in_world.position, in_world.approach))
    lines = [
        *([f"**grasp** {marker.number}"] if marker.number else []),
        f"**score** {in_world.score:.3f}",
        f"**width** {in_world.width * 1000:.0f} mm",
        f"**TCP in the world** {place} m",
        f"**approach** {approach}",
    ]
    return "  \n".join([*lines, marker.note] if marker.note else lines)


@lru_cache(maxsize=8)
def _seen_through(node: MeshNode) -> MeshNode:
    """A mesh inside of which the axes can be seen."""
    return replace(node, opacity=0.45)


def _is_in(region: Box, marker: GraspMarker | None, data: SceneData) -> bool:
    """Whether the TCP of a grasp lies in a box of the world."""
    if marker is None:
        return True
    place = apply(data.workspace.world_from_workspace, marker.grasp.position)
    return bool(np.all((place >= region[:3]) & (place <= region[3:])))


def _score(node: MeshNode) -> float:
    return node.marker.grasp.score if node.marker else 1.0


@lru_cache(maxsize=4)
def _table(data: SceneData) -> PictureNode:
    workspace = data.workspace
    middle = workspace.centre - (0, 0, BELOW_TABLE)
    pose = rigid(np.diag([1.0, -1.0, -1.0]), middle)
    side = edge(workspace)
    return PictureNode("table", tabletop(data.photos, workspace), side, side, pose, has_shadows=True)


@lru_cache(maxsize=4)
def _cube(data: SceneData) -> LinesNode:
    return LinesNode("cube", _edges(data.workspace.corners()), CUBE, 0.001)


@lru_cache(maxsize=4)
def _region(data: SceneData, region: Box) -> LinesNode:
    """A box of the world, in the workspace frame."""
    corners = np.array(list(product(*zip(region[:3], region[3:], strict=True))))
    moved = apply(inverse(data.workspace.world_from_workspace), _edges(corners))
    return LinesNode("region", moved, CHOSEN, 0.0015)


def _edges(corners: Array) -> Array:
    """(12, 2, 3): the edges between the corners (8, 3) of a box along the axes."""
    pairs = [(a, b) for i, a in enumerate(corners) for b in corners[i + 1 :]]
    return np.array([(a, b) for a, b in pairs if np.count_nonzero(a != b) == 1])


@lru_cache(maxsize=16)
def _surface(data: SceneData, moment: Snapshot, colouring: Colouring, has_table: bool) -> MeshNode:
    assert moment.tsdf is not None
    workspace = data.workspace
    surface = (fine_surface if has_table else things_on_table)(moment.tsdf, workspace)
    field = Field(moment.tsdf, workspace)
    colour: Colour | np.ndarray = PLAIN
    if len(surface.vertices) and colouring == "photos" and data.photos:
        colour = by_photos(surface, field, data.photos)
    elif len(surface.vertices) and colouring == "views" and data.photos:
        colour = by_views(surface, field, data.photos)
    elif len(surface.vertices) and colouring == "confidence":
        colour = by_confidence(surface, field)
    return MeshNode("surface", surface, colour)


@lru_cache(maxsize=64)
def _solids(moment: Snapshot) -> tuple[MeshNode, ...]:
    return tuple(
        MeshNode(f"bodies/{i} {solid.name}", solid.surface, solid.colour)
        for i, solid in enumerate(moment.solids)
    )


@lru_cache(maxsize=4)
def _truth(data: SceneData) -> tuple[MeshNode, ...]:
    """Known bodies where there are any, else the surface fused from depth images."""
    truth = data.truth
    if truth.solids:
        return tuple(
            MeshNode(f"truth/bodies/{i} {solid.name}", solid.surface, TRUE, 0.55)
            for i, solid in enumerate(truth.solids)
        )
    if truth.tsdf is None:
        return ()
    return (MeshNode("truth/surface", things_on_table(truth.tsdf, data.workspace), TRUE, 0.55),)


@lru_cache(maxsize=64)
def _hands(
    data: SceneData, candidates: tuple[GraspMarker, ...], hand: Hand, folder: str
) -> tuple[MeshNode, ...]:
    nodes = []
    for number, marker in enumerate(candidates):
        width = min(marker.grasp.width, data.gripper.max_opening)
        mesh = HAND_MESHES[hand](data.gripper, width)
        colour = TRUE if folder.startswith("truth") else colour_of(marker)
        nodes.append(
            MeshNode(f"{folder}/{number:03d}", mesh.moved(marker.grasp.pose), colour, 1.0, True, marker)
        )
    return tuple(nodes)


@lru_cache(maxsize=8)
def _slice(data: SceneData, moment: Snapshot, axis: int, index: int) -> PictureNode:
    grid: Grid | None = moment.tsdf
    assert grid is not None
    workspace = data.workspace
    picture = np.dstack(
        [slice_picture(grid, workspace, axis, index, SLICE_PIXELS), _opacity(grid, axis, index)]
    )
    middle = np.full(3, workspace.size / 2)
    middle[axis] = workspace.position_of(index)
    return PictureNode("slice", picture, workspace.size, workspace.size, rigid(slice_frame(axis), middle))


def _opacity(grid: Grid, axis: int, index: int) -> NDArray[np.uint8]:
    """(p, p) of a slice: full at the surface, a third where the distance is cut off."""
    nearness = 1 - np.abs(np.take(grid, index, axis=axis).T[::-1]).clip(0, 1)
    small = (255 * (0.35 + 0.65 * np.sqrt(nearness))).astype(np.uint8)
    return np.asarray(
        Picture.fromarray(small).resize((SLICE_PIXELS, SLICE_PIXELS), Picture.Resampling.BILINEAR)
    )


def slice_frame(axis: int) -> Array:
    """Columns right, down and away of the picture of a slice looked at along `axis`."""
    right, up = (np.eye(3)[a] for a in range(3) if a != axis)
    return np.stack([right, -up, np.cross(right, -up)], axis=1)
