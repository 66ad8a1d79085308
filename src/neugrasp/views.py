"""What detectors receive: photos, photos of the empty table, and cameras; or depth images and cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.workspace import Workspace

Image = NDArray[np.uint8]
"""RGB, (height, width, 3)."""

MAX_VIEWS = 8


@dataclass(frozen=True)
class View:
    """One photo of the objects and one of the empty table from the same camera."""

    image: Image
    background: Image
    camera: Camera
    """`world_from_camera` is in the user's world."""
    name: str = ""
    """Where it came from, for messages."""


@dataclass(frozen=True)
class Views:
    """Everything a detector may know about a scene. Raises `InputError` on 0 or more than 8 views."""

    views: tuple[View, ...]
    workspace: Workspace
    source: str = ""
    """The folder that they were read from, where there is one."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.views) <= MAX_VIEWS:
            raise InputError(f"{len(self.views)} views given; a scene has 1 to {MAX_VIEWS} views")

    def __len__(self) -> int:
        return len(self.views)


@dataclass(frozen=True)
class DepthView:
    """One depth image."""

    depth: NDArray[np.float32]
    """(height, width) z-depth in metres; 0 where nothing was measured."""
    camera: Camera
    """`world_from_camera` is in the user's world."""


@dataclass(frozen=True)
class DepthViews:
    """Everything a detector that needs depth may know about a scene."""

    views: tuple[DepthView, ...]
    workspace: Workspace
