"""What detectors receive: frames with their cameras, and the workspace in which grasps are sought.

`Observation` holds whichever channels there are. The types below it say which ones are there for certain, so
that an algorithm on photos cannot be handed depth images alone.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import inverse
from neugrasp.geometry.workspace import Workspace

Image = NDArray[np.uint8]
"""RGB, (height, width, 3)."""
Depth = NDArray[np.float32]
"""(height, width) z-depth in metres; 0 where nothing was measured."""

MAX_VIEWS = 8
PREVIEW = 240
"""Pixels of the height of a photo in a notebook."""
CHANNELS = {"image": "photo", "background": "photo of the empty table", "depth": "depth image"}
"""Fields of a frame that hold a picture, and what they are called in messages."""


@dataclass(frozen=True, repr=False)
class Frame:
    """What one camera saw. Raises `InputError` where a picture is not of the camera's size, or there is
    none."""

    camera: Camera
    """`world_from_camera` is in the user's world."""
    image: Image | None = None
    """The objects on the table."""
    background: Image | None = None
    """The empty table from the same camera."""
    depth: Depth | None = None
    stamp: float | None = None
    """Seconds at which the objects were seen, by any clock that the frames share."""
    name: str = ""
    """Where it came from, for messages."""

    def __post_init__(self) -> None:
        height, width = self.camera.height, self.camera.width
        for channel in self.channels:
            picture = getattr(self, channel)
            shape, kind = ((height, width), "f") if channel == "depth" else ((height, width, 3), "u")
            if picture.shape != shape or picture.dtype.kind != kind:
                raise InputError(
                    f"{self.name or 'a frame'}: its {CHANNELS[channel]} is {picture.dtype} {picture.shape}; "
                    f"its camera takes {shape}, {'metres as floats' if kind == 'f' else 'uint8'}"
                )

    def __repr__(self) -> str:
        place = ", ".join(f"{x:+.3f}" for x in self.camera.centre)
        name = f"{self.name}, " if self.name else ""
        size = f"{self.camera.width} x {self.camera.height}"
        return f"{type(self).__name__}({name}{size} pixels, from ({place}) m)"

    def _repr_png_(self) -> bytes | None:
        """The photo beside the empty table, for notebooks; None where there is neither."""
        photos = [photo for photo in (self.image, self.background) if photo is not None]
        return _png(np.concatenate(photos, axis=1)) if photos else None

    @property
    def channels(self) -> frozenset[str]:
        """Which of the pictures there are: of "image", "background" and "depth"."""
        return frozenset(channel for channel in CHANNELS if getattr(self, channel) is not None)


@dataclass(frozen=True, repr=False)
class View(Frame):
    """A frame with a photo of the objects and one of the empty table."""

    image: Image = field()
    background: Image = field()


@dataclass(frozen=True, kw_only=True, repr=False)
class DepthView(Frame):
    """A frame with a depth image."""

    depth: Depth = field()


@dataclass(frozen=True, repr=False)
class Observation:
    """Everything a detector may know about a scene. Raises `InputError` on 0 or more than 8 frames, on frames
    whose channels differ, and on frames without a picture."""

    frames: Sequence[Frame]
    workspace: Workspace
    source: str = ""
    """The folder that they were read from, where there is one."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.frames) <= MAX_VIEWS:
            raise InputError(f"{len(self.frames)} views given; a scene has 1 to {MAX_VIEWS} views")
        for i, frame in enumerate(self.frames):
            if frame.channels != self.channels or not frame.channels:
                raise InputError(
                    f"view {i} has {_words(frame.channels)}, view 0 has {_words(self.channels)}; "
                    "all views of a scene see the same, and at least one picture"
                )

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def views(self) -> Sequence[Frame]:
        """The frames, by the name that they had before version 0.2."""
        return self.frames

    def __repr__(self) -> str:
        sizes = sorted({(frame.camera.width, frame.camera.height) for frame in self.frames})
        pixels = ", ".join(f"{width} x {height}" for width, height in sizes)
        source = f" of {self.source}" if self.source else ""
        return f"{type(self).__name__}({len(self)} frames{source}, {pixels} pixels)"

    def _repr_png_(self) -> bytes | None:
        """Small photos in a row, their empty tables below, for notebooks; None where there are none."""
        rows = [
            np.concatenate([_small(getattr(frame, channel)) for frame in self.frames], axis=1)
            for channel in ("image", "background")
            if channel in self.channels
        ]
        return _png(np.concatenate(rows)) if rows else None

    def in_workspace_frame(self) -> Self:
        """The same, described in the frame of its cube."""
        workspace_from_world = inverse(self.workspace.world_from_workspace)
        frames = tuple(replace(f, camera=f.camera.moved(workspace_from_world)) for f in self.frames)
        return replace(self, frames=frames, workspace=replace(self.workspace, world_from_workspace=np.eye(4)))

    @property
    def channels(self) -> frozenset[str]:
        """Which pictures every frame has: of "image", "background" and "depth"."""
        return self.frames[0].channels


@dataclass(frozen=True, repr=False)
class Views(Observation):
    """An observation whose every frame has a photo and a background."""

    frames: Sequence[View]


@dataclass(frozen=True, repr=False)
class DepthViews(Observation):
    """An observation whose every frame has a depth image."""

    frames: Sequence[DepthView]


Narrow = TypeVar("Narrow", bound=Frame)


def with_backgrounds(seen: Observation) -> Views:
    """The observation as `Views`. Raises `InputError` where photos or backgrounds are missing."""
    if isinstance(seen, Views):
        return seen
    return Views(_narrowed(seen, View, {"image", "background"}), seen.workspace, seen.source)


def with_photos(seen: Observation) -> Views:
    """The observation as `Views` for those who never read backgrounds: where there are none, each photo
    stands for its own. Raises `InputError` where photos are missing."""
    if missing := {"image"} - seen.channels:
        raise _lacking(seen, missing)
    if "background" in seen.channels:
        return with_backgrounds(seen)
    frames = tuple(replace(frame, background=frame.image) for frame in seen.frames)
    return with_backgrounds(replace(seen, frames=frames))


def with_depth(seen: Observation) -> DepthViews:
    """The observation as `DepthViews`. Raises `InputError` where depth images are missing."""
    if isinstance(seen, DepthViews):
        return seen
    return DepthViews(_narrowed(seen, DepthView, {"depth"}), seen.workspace, seen.source)


def _narrowed(seen: Observation, kind: type[Narrow], needed: set[str]) -> tuple[Narrow, ...]:
    if missing := needed - seen.channels:
        raise _lacking(seen, missing)
    names = [one.name for one in fields(Frame)]
    return tuple(kind(**{name: getattr(frame, name) for name in names}) for frame in seen.frames)


def _lacking(seen: Observation, missing: set[str]) -> InputError:
    return InputError(
        f"{seen.source or 'the observation'}: has {_words(seen.channels)}, and no {_words(missing)}; "
        "this detector needs it"
    )


def _small(image: Image) -> Image:
    height, width = image.shape[:2]
    size = (max(1, round(width * PREVIEW / height)), PREVIEW)
    return np.asarray(Picture.fromarray(image).resize(size, Picture.Resampling.BOX))


def _png(image: Image) -> bytes:
    stream = io.BytesIO()
    Picture.fromarray(image).save(stream, format="PNG")
    return stream.getvalue()


def _words(channels: frozenset[str] | set[str]) -> str:
    """Names of pictures for a message."""
    named = [words for channel, words in CHANNELS.items() if channel in channels]
    return " and ".join(named) or "no picture"
