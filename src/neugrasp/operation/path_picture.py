"""The way of an arm drawn beside surface and grasp: from the side and from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw

from neugrasp.geometry.pose import Array, apply, inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import Image
from neugrasp.robot.attended import Step
from neugrasp.robot.motion import Motion
from neugrasp.robot.rehearsal import Rehearsal

SIDE = 900
"""Pixels of a panel."""
OVERSAMPLING = 2
MARGIN = 0.08
"""Share of a panel around what is drawn."""
LINE = 18
"""Pixels from one line of the legend to the next."""
ARM, TABLE, SURFACE, GRASP = (150, 156, 166), (205, 190, 160), (90, 130, 190), (20, 140, 80)
COLOURS = (
    (31, 119, 180), (255, 127, 14), (148, 103, 189), (214, 39, 40), (140, 86, 75), (227, 119, 194),
    (23, 190, 207), (188, 189, 34), (44, 160, 44), (90, 90, 90),
)  # fmt: skip
"""Colours of the motions, one after the other."""


@dataclass(frozen=True)
class _Line:
    """A polyline in the workspace frame, or points where its thickness is 0."""

    points: Array
    """(n, 3)"""
    colour: tuple[int, int, int]
    thickness: int


def path_picture(rehearsal: Rehearsal, workspace: Workspace, planner: Motion) -> Image:
    """RGB: side view and view from above; `workspace` and `planner` are in the world of the cell file."""
    moves = [step for step in rehearsal.steps if step.motion is not None]
    lines = [*_table(workspace), *_surface(rehearsal), *_arm(moves, workspace, planner)]
    lines += [*_ways(moves, workspace, planner), *_grasp(rehearsal)]
    width = SIDE * OVERSAMPLING
    height = width + LINE * OVERSAMPLING * (len(moves) // 2 + 2)
    picture = Picture.new("RGB", (2 * width, height), "white")
    pen = ImageDraw.Draw(picture)
    for number, (axes, title) in enumerate((((0, 2), "from the side"), ((0, 1), "from above"))):
        _panel(pen, lines, axes, number * width, width)
        pen.text((number * width + 20, 12), title, fill="black", font_size=14 * OVERSAMPLING)
    for number, step in enumerate(moves):
        place = (20 + (number % 2) * width, width + (number // 2) * LINE * OVERSAMPLING)
        pen.text(place, step.what, fill=_colour(number), font_size=13 * OVERSAMPLING)
    return np.asarray(picture.resize((2 * SIDE, height // OVERSAMPLING), Picture.Resampling.BOX))


def _panel(
    pen: ImageDraw.ImageDraw, lines: Sequence[_Line], axes: tuple[int, int], left: int, size: int
) -> None:
    every = np.concatenate([line.points for line in lines])[:, axes]
    low, high = every.min(axis=0), every.max(axis=0)
    scale = (1 - 2 * MARGIN) * size / float((high - low).max())
    middle = (low + high) / 2
    for line in lines:
        flat = (line.points[:, axes] - middle) * scale * [1, -1] + [left + size / 2, size / 2]
        places = [(float(x), float(y)) for x, y in flat]
        if line.thickness:
            pen.line(places, fill=line.colour, width=line.thickness * OVERSAMPLING, joint="curve")
        else:
            for x, y in places:
                pen.rectangle((x, y, x + OVERSAMPLING, y + OVERSAMPLING), fill=line.colour)


def _colour(number: int) -> tuple[int, int, int]:
    return COLOURS[number % len(COLOURS)]


def _table(workspace: Workspace) -> list[_Line]:
    corners = workspace.corners(workspace.table_height, workspace.size)
    edges = [(a, b) for i, a in enumerate(corners) for b in corners[i + 1 :]]
    return [_Line(np.array(edge), TABLE, 1) for edge in edges if np.count_nonzero(edge[0] != edge[1]) == 1]


def _surface(rehearsal: Rehearsal) -> list[_Line]:
    detection = rehearsal.detection
    if detection.tsdf is None:
        return []
    vertices = detection.surface().vertices
    return [_Line(_local(detection.workspace, vertices), SURFACE, 0)] if len(vertices) else []


def _local(workspace: Workspace, points: Array) -> Array:
    return np.asarray(apply(inverse(workspace.world_from_workspace), points))


def _arm(moves: Sequence[Step], workspace: Workspace, planner: Motion) -> list[_Line]:
    """The arm at the end of every motion: its joints, the flange and the TCP, joined by lines."""
    fence, lines = planner.fence, []
    for step in moves:
        assert step.motion is not None
        frames = fence.world_from_base @ fence.model.frames(step.motion.joints[-1])
        chain = [*frames[:, :3, 3], planner.tcp(step.motion.joints[-1])[:3, 3]]
        lines.append(_Line(_local(workspace, np.array(chain)), ARM, 2))
    return lines


def _ways(moves: Sequence[Step], workspace: Workspace, planner: Motion) -> list[_Line]:
    """Where the TCP goes."""
    ways = []
    for number, step in enumerate(moves):
        assert step.motion is not None
        places = planner.tcp(step.motion.joints)[:, :3, 3]
        ways.append(_Line(_local(workspace, places), _colour(number), 3))
    return ways


def _grasp(rehearsal: Rehearsal) -> list[_Line]:
    grasp, detection = rehearsal.grasp, rehearsal.detection
    if grasp is None:
        return []
    segments = apply(grasp.pose, detection.gripper.wireframe(min(grasp.width, detection.gripper.max_opening)))
    return [_Line(_local(detection.workspace, segment), GRASP, 4) for segment in segments]
