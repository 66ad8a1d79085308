"""The gripper of a grasp as a mesh, from the convex parts of the gripper's file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull

from neugrasp.geometry.pose import Array, rigid
from neugrasp.geometry.surface import Surface
from neugrasp.gripper import Gripper

BAR = 0.004
"""Edge in metres of the square section of bars that stand for lines."""


def hand_mesh(gripper: Gripper, opening: float, has_palm: bool = True) -> Surface:
    """The hand in the grasp frame, its pads `opening` metres apart."""
    setback = float(gripper.tip_setback(opening))
    parts = [*gripper.finger_hulls(opening, setback), *(gripper.palm.hulls if has_palm else ())]
    hand = joined([convex(part) for part in parts])
    return hand.moved(rigid(translation=(0, 0, setback - gripper.tcp_height)))


def finger_mesh(gripper: Gripper, opening: float) -> Surface:
    """The fingers on thin bars instead of the palm, in the grasp frame: what they hold stays in sight."""
    return joined([hand_mesh(gripper, opening, has_palm=False), bar_mesh(gripper, opening)])


def bar_mesh(gripper: Gripper, opening: float) -> Surface:
    """The wireframe of the gripper as thin bars, in the grasp frame."""
    bars = []
    for start, end in gripper.wireframe(opening):
        low, high = np.minimum(start, end) - BAR / 2, np.maximum(start, end) + BAR / 2
        choice = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), -1).reshape(8, 3)
        bars.append(convex(np.where(choice == 1, high, low)))
    return joined(bars)


def convex(points: Array) -> Surface:
    """The convex hull of points (n, 3), its faces anticlockwise seen from outside."""
    hull = ConvexHull(points)
    corners = points[hull.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = (normals * hull.equations[:, :3]).sum(axis=1) < 0
    faces = np.where(inwards[:, None], hull.simplices[:, ::-1], hull.simplices)
    used, compact = np.unique(faces, return_inverse=True)
    return Surface(points[used], compact.reshape(-1, 3).astype(np.int32))


def joined(surfaces: Sequence[Surface]) -> Surface:
    """Several meshes as one."""
    starts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    faces = [surface.faces + start for surface, start in zip(surfaces, starts, strict=False)]
    return Surface(
        np.concatenate([surface.vertices for surface in surfaces]), np.concatenate(faces).astype(np.int32)
    )
