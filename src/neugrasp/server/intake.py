"""What a request brings, checked as a scene on disk is, and before anything large is decoded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from neugrasp.data.camera_checks import check_scene
from neugrasp.data.fields import Fields
from neugrasp.data.known_keys import refuse_bends
from neugrasp.data.photo_files import Photo, image_size, photo_tags, read_image
from neugrasp.data.scene_folder import FILE, STRAIGHT, VIEW_KEYS, camera_of, checked_head, workspace_of
from neugrasp.data.strict_json import parse_json
from neugrasp.detection.options import Box, Cone, Steering
from neugrasp.doctor.examination import KnownTable
from neugrasp.doctor.photo_tags import Told
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import MAX_VIEWS, Frame, Image, Observation, View, Views

STEERING = ("region", "mask_view", "approach", "min_height", "one_object", "top")
FARTHEST = 1e6
"""Metres from the world's origin within which a region lies."""


@dataclass(frozen=True)
class Cell:
    """Cameras with their photos of the empty table: what stays while objects come and go."""

    workspace: Workspace
    frames: tuple[Frame, ...]
    """With cameras and backgrounds."""
    told: tuple[Told, ...]
    """What the backgrounds say of themselves."""
    table: KnownTable | None = None
    """The doctor's word on the table, where it is known before there are photos."""

    def empty(self) -> Views:
        """The cell as it looks without objects."""
        views = tuple(View(f.camera, _there(f.background), _there(f.background)) for f in self.frames)
        return Views(views, self.workspace)


@dataclass(frozen=True)
class Seen:
    """A scene, and what its photos say of themselves."""

    views: Views
    told: tuple[Told, ...]
    table: KnownTable | None = None
    """As of the cell."""


def cell_of(scene: bytes, backgrounds: Sequence[Photo], most_pixels: int) -> Cell:
    """The cell of a scene.json, whose names of photos are not looked at, and the photos of the empty table,
    in the order of its views.

    Raises `InputError` where `read_scene` would.
    """
    data = parse_json(scene, FILE, judges_values=False)
    if not isinstance(data, dict):
        raise InputError(f"{FILE}: not a scene; it must be an object in braces")
    data = checked_head(data, Path(FILE))
    workspace = workspace_of(data, Path(FILE))
    entries = data.get("views")
    if not isinstance(entries, list) or not 1 <= len(entries) <= MAX_VIEWS:
        raise InputError(f"{FILE}: 'views' must be a list of 1 to {MAX_VIEWS} views")
    _check_count(backgrounds, "background", len(entries))
    frames, told = [], []
    for number, (entry, photo) in enumerate(zip(entries, backgrounds, strict=True)):
        where = f"{FILE}, view {number}"
        if not isinstance(entry, dict):
            raise InputError(f"{where}: must be an object with intrinsics and world_from_camera")
        refuse_bends(entry, VIEW_KEYS, where, STRAIGHT)
        background = _decoded(photo, where, most_pixels)
        camera = camera_of(entry, background, where)
        frames.append(Frame(camera, background=background, name=photo.name))
        told.append(Told(photo.name, photo_tags(photo, where), camera))
    check_scene(Observation(frames, workspace), FILE)
    return Cell(workspace, tuple(frames), tuple(told))


def seen_at(cell: Cell, images: Sequence[Photo], most_pixels: int) -> Seen:
    """The photos of a scene, in the order of the cell's views. Raises `InputError` where one is none."""
    _check_count(images, "image", len(cell.frames))
    views, told = [], list(cell.told)
    for number, (frame, photo) in enumerate(zip(cell.frames, images, strict=True)):
        where = f"view {number}"
        image, background = _decoded(photo, where, most_pixels), _there(frame.background)
        if image.shape != background.shape:
            (height, width), (rows, columns) = image.shape[:2], background.shape[:2]
            raise InputError(
                f"{photo}: image of {width} x {height} pixels, background of {columns} x {rows}; {where} "
                "needs both from the same camera at the same size"
            )
        views.append(View(frame.camera, image, background, name=photo.name))
        told.append(Told(photo.name, photo_tags(photo, where), frame.camera))
    return Seen(Views(tuple(views), cell.workspace), tuple(told), cell.table)


def steering_of(text: str, mask: Path | None = None) -> Steering:
    """What is wanted, from an object of JSON with the names of `Steering`; of a `mask` it says the view.

    Raises `InputError` naming the field.
    """
    given = Fields("steering", parse_json(text or "{}", "steering"))
    given.only(STEERING)
    if (mask is None) != ("mask_view" not in given.data):
        raise InputError(
            "steering: a mask is a part 'mask' of the request, and 'mask_view', the view it is of"
        )

    def wanted(name: str, read: Callable[[str], Any]) -> Any:
        return read(name) if name in given.data else None

    def row(length: int, what: str) -> Callable[[str], Any]:
        return lambda name: tuple(given.numbers(name, length, FARTHEST, what).tolist())

    view = wanted("mask_view", lambda name: given.whole(name, 0, MAX_VIEWS - 1))
    return Steering(
        region=cast(Box | None, wanted("region", row(6, "[x, y, z from, x, y, z to] in metres"))),
        mask=None if mask is None else (view, mask),
        approach=cast(Cone | None, wanted("approach", row(4, "[x, y, z, degrees]"))),
        min_height=wanted("min_height", lambda name: given.number(name, -1, 1, "m")),
        one_object=bool(wanted("one_object", given.flag)),
        top=wanted("top", lambda name: given.whole(name, 1, 10**6)),
    )


def _check_count(photos: Sequence[Photo], part: str, count: int) -> None:
    if len(photos) != count:
        raise InputError(
            f"{len(photos)} parts {part!r}; there must be one for each of {count} views, in order"
        )


def _decoded(photo: Photo, where: str, most_pixels: int) -> Image:
    width, height = image_size(photo, where)
    if width * height > most_pixels:
        most = f"{most_pixels / 1e6:g} megapixels"
        raise InputError(f"{photo}: {width} x {height} pixels; {where}: this server reads at most {most}")
    return read_image(photo, where)


def _there(background: Image | None) -> Image:
    """The background of a cell's frame, which has one."""
    assert background is not None
    return background
