"""The table as seen straight from above, put together from the photos of the empty table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import View

PIXELS = 600
"""Pixels of an edge of the picture."""
MARGIN = 0.06
"""Metres of table drawn around the cube, where the photos show it."""
FADE = 0.08
"""The part of a photo, from its edge, over which it fades out."""
DEFAULT = (226, 224, 220)
"""Colour of a table that no photo shows."""


def edge(workspace: Workspace) -> float:
    """The edge of the drawn table, metres."""
    return workspace.size + 2 * MARGIN


def tabletop(views: Sequence[View], workspace: Workspace) -> NDArray[np.uint8]:
    """RGBA (p, p, 4), x of the workspace to the right, y upwards; transparent where no photo shows the table.

    `views` are in the workspace frame. Where several see a place, their mean, most of those above it.
    """
    place = (np.arange(PIXELS) + 0.5) / PIXELS * edge(workspace) - MARGIN
    x, y = np.meshgrid(place, place[::-1])
    points = np.stack([x, y, np.full_like(x, workspace.table_height)], axis=-1)
    colours, weights = np.zeros((PIXELS, PIXELS, 3)), np.zeros((PIXELS, PIXELS))
    for view in views:
        pixels, depth = view.camera.project(points)
        low, high = np.array(view.camera.bounds).reshape(2, 2)
        border = np.minimum(pixels - low, high - pixels).min(axis=-1) / (high - low).min()
        line = view.camera.centre - points
        squarely = line[..., 2] / np.linalg.norm(line, axis=-1)
        weight = np.where(depth > 0, (border / FADE).clip(0, 1), 0) * squarely.clip(0, 1)
        channels = [view.background[..., c].astype(float) for c in range(3)]
        order = (pixels[..., 1], pixels[..., 0])
        seen = np.stack([map_coordinates(c, order, order=1, mode="nearest") for c in channels], axis=-1)
        colours += weight[..., None] * seen
        weights += weight
    if not views:
        colours, weights = np.broadcast_to(DEFAULT, colours.shape).astype(float), np.ones_like(weights)
    opacity = 255 * (weights * 2).clip(0, 1)
    picture = np.concatenate([colours / np.maximum(weights, 1e-9)[..., None], opacity[..., None]], axis=-1)
    return picture.round().clip(0, 255).astype(np.uint8)
