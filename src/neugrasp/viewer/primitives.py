"""What is drawn, as plain data: the viewer's alphabet. Everything is in the workspace frame, metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp.geometry.pose import Array
from neugrasp.geometry.surface import Surface
from neugrasp.viewer.scene_data import Colour, GraspMarker


@dataclass(frozen=True, eq=False)
class MeshNode:
    """A mesh of one colour, or of one colour per vertex."""

    name: str
    surface: Surface
    colour: Colour | NDArray[np.uint8]
    """RGB, or (n, 3) for n vertices."""
    opacity: float = 1.0
    """Opacity of meshes of one colour."""
    is_faceted: bool = False
    """Whether its edges are to be seen; for meshes of one colour."""
    marker: GraspMarker | None = None
    """The grasp that a click on the mesh selects."""


@dataclass(frozen=True, eq=False)
class PictureNode:
    """A flat picture in space: x of its frame to the right, y downwards, the origin in its middle."""

    name: str
    pixels: NDArray[np.uint8]
    """(h, w, 3), or (h, w, 4) where parts of it are transparent."""
    width: float
    height: float
    pose: Array
    """`workspace_from_picture`"""
    has_shadows: bool = False
    """Whether what stands above it throws its shadow on it."""


@dataclass(frozen=True, eq=False)
class LinesNode:
    """Straight lines of one colour."""

    name: str
    segments: Array
    """(k, 2, 3)"""
    colour: Colour
    thickness: float


@dataclass(frozen=True, eq=False)
class AxesNode:
    """Three arrows: x red, y green, z blue."""

    name: str
    pose: Array
    length: float


@dataclass(frozen=True, eq=False)
class LabelNode:
    """A word at a place, in front of everything."""

    name: str
    text: str
    position: Array


Node = MeshNode | PictureNode | LinesNode | AxesNode | LabelNode
