"""A cut through a signed distance grid, in colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import map_coordinates

from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import Image

INSIDE, SURFACE, OUTSIDE = np.array([178, 24, 43]), np.array([247, 247, 247]), np.array([33, 102, 172])
CONTOUR = np.array([20, 20, 20])
TABLE_LINE = np.array([120, 120, 120])


def busiest_slice(tsdf: ArrayLike, workspace: Workspace, axis: int = 1) -> int:
    """The index along `axis` whose slice holds the most matter above the table."""
    grid = np.asarray(tsdf)
    above = workspace.position_of(np.arange(grid.shape[2])) > workspace.table_height + workspace.voxel_size
    other = tuple(a for a in range(3) if a != axis)
    return int(np.argmax(((grid < 0) & above).sum(axis=other)))


def slice_picture(
    tsdf: ArrayLike, workspace: Workspace, axis: int = 1, index: int | None = None, size: int = 512
) -> Image:
    """A slice of a grid [x, y, z] in [-1, 1]: blue outside, red inside, a black line at zero, a grey one at
    the height of the table.

    `axis` is the one looked along (1: x to the right, z up); `index` is the busiest slice by default.
    """
    grid = np.asarray(tsdf, dtype=np.float32)
    index = busiest_slice(grid, workspace, axis) if index is None else index
    # Rows are the later of the two axes that remain, upwards.
    plane = np.take(grid, index, axis=axis).T[::-1]
    row, column = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    cells = [(pixel + 0.5) * n / size - 0.5 for pixel, n in ((row, plane.shape[0]), (column, plane.shape[1]))]
    values = map_coordinates(plane, cells, order=1, mode="nearest").clip(-1, 1)
    target = np.where(values[..., None] > 0, OUTSIDE, INSIDE)
    picture = SURFACE + (target - SURFACE) * np.abs(values[..., None]) ** 0.7
    if axis != 2:
        table_row = round((1 - workspace.table_height / workspace.size) * size)
        picture[table_row : table_row + 2, :: size // 64] = TABLE_LINE
    picture[_contour(values > 0)] = CONTOUR
    return picture.round().astype(np.uint8)


def _contour(outside: np.ndarray) -> np.ndarray:
    """The pixels that touch one of the other side: a line two pixels wide."""
    line = np.zeros_like(outside)
    changes_down, changes_right = outside[1:] != outside[:-1], outside[:, 1:] != outside[:, :-1]
    line[1:] |= changes_down
    line[:-1] |= changes_down
    line[:, 1:] |= changes_right
    line[:, :-1] |= changes_right
    return line
