"""Which object a visitor points at."""

from __future__ import annotations

import numpy as np

from neugrasp.detection.things import Thing, things_in
from neugrasp.geometry.pose import Array
from neugrasp.geometry.workspace import Workspace
from neugrasp.viewer.scene_data import Grid

STEP = 0.25
"""Voxels between the places of a line of sight that are looked at."""
BESIDE = 1.0
"""Voxels from a thing's voxel centres within which a line meets the thing."""


def object_on_line(grid: Grid, workspace: Workspace, origin: Array, direction: Array) -> Thing | None:
    """The first thing that a line of sight (workspace frame) meets; None where it meets none before the
    table."""
    things = things_in(grid, workspace)
    length = float(np.linalg.norm(direction))
    if not things or not length > 0:
        return None
    far = float(np.linalg.norm(origin - workspace.centre)) + workspace.size
    along = np.arange(0, far, STEP * workspace.voxel_size)[:, None] * direction / length
    places = (origin + along)[workspace.contains(origin + along)]
    places = places[places[:, 2] > workspace.table_height]
    for place in places:
        distances = [thing.distance(place) for thing in things]
        if min(distances) <= BESIDE * workspace.voxel_size:
            return things[int(np.argmin(distances))]
    return None
