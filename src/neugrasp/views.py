"""What detectors receive: photos, photos of the empty table, and cameras; or depth images and cameras."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.workspace import Workspace

Image = NDArray[np.uint8]
"""RGB, (height, width, 3)."""

MAX_VIEWS = 8
PREVIEW = 240
"""Pixels of the height of a photo in a notebook."""


@dataclass(frozen=True)
class View:
    """One photo of the objects and one of the empty table from the same camera."""

    image: Image
    background: Image
    camera: Camera
    """`world_from_camera` is in the user's world."""
    name: str = ""
    """Where it came from, for messages."""

    def __repr__(self) -> str:
        place = ", ".join(f"{x:+.3f}" for x in self.camera.centre)
        name = f"{self.name}, " if self.name else ""
        return f"View({name}{self.camera.width} x {self.camera.height} pixels, from ({place}) m)"

    def _repr_png_(self) -> bytes | None:
        """The photo beside the empty table, for notebooks."""
        return _png(np.concatenate([self.image, self.background], axis=1)) if self.image.size else None


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

    def __repr__(self) -> str:
        sizes = sorted({(view.camera.width, view.camera.height) for view in self.views})
        pixels = ", ".join(f"{width} x {height}" for width, height in sizes)
        source = f" of {self.source}" if self.source else ""
        return f"Views({len(self)} photos{source}, {pixels} pixels)"

    def _repr_png_(self) -> bytes | None:
        """Small photos in a row, their empty tables below, for notebooks."""
        if not all(view.image.size for view in self.views):
            return None
        rows = ([view.image for view in self.views], [view.background for view in self.views])
        return _png(np.concatenate([np.concatenate([_small(one) for one in row], axis=1) for row in rows]))


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


def _small(image: Image) -> Image:
    height, width = image.shape[:2]
    size = (max(1, round(width * PREVIEW / height)), PREVIEW)
    return np.asarray(Picture.fromarray(image).resize(size, Picture.Resampling.BOX))


def _png(image: Image) -> bytes:
    stream = io.BytesIO()
    Picture.fromarray(image).save(stream, format="PNG")
    return stream.getvalue()
