"""A scene on disk, as a user captures it: `scene.json`, the photos, and the photos of the empty table.

The format is written down in docs/data_format.md. What else lies in the folder is ignored.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np
from PIL import Image as Picture

from neugrasp.data.camera_checks import check_intrinsics, check_rigid, check_scene, check_sensed, numbers
from neugrasp.data.known_keys import refuse_bends, warn_of_unknown
from neugrasp.data.photo_files import read_image
from neugrasp.data.spelling import plain
from neugrasp.data.strict_json import read_object
from neugrasp.data.user_files import check_name
from neugrasp.errors import InputError, SceneError, told_as
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.workspace import USUAL, Workspace
from neugrasp.observation import MAX_VIEWS, Image, View, Views
from neugrasp.output import write_text

FORMAT = "neugrasp-scene"
VERSION = 1
FILE = "scene.json"
SCENE_KEYS = ("format", "version", "workspace", "views")
WORKSPACE_KEYS = ("size", "world_from_workspace", "resolution", "table_height", "truncation")
EDGES = (0.05, 2.0)
"""Metres between which the edge of a cube lies."""
VIEW_KEYS = ("image", "background", "intrinsics", "world_from_camera", "sensed")
SIZE_KEYS = {
    **dict.fromkeys(("width", "w", "imagewidth", "imgwidth"), 1),
    **dict.fromkeys(("height", "h", "imageheight", "imgheight"), 0),
}
"""Keys, in plain letters, that say for which photo the intrinsics are, with its axis."""
STRAIGHT = (
    "photos of a scene are those of a pinhole, its poses are metric: undistort and convert, e.g. with "
    "`neugrasp import robot`, and leave it away"
)
"""What to do about keys that say otherwise."""

logger = logging.getLogger(__name__)


@told_as(SceneError)
def read_scene(path: str | Path) -> Views:
    """The scene in folder `path` (or whose `scene.json` is `path`).

    Raises `SceneError` that names the file and the view, what is wrong, and what would be right.
    """
    path = Path(path)
    folder = path.parent if path.name == FILE else path
    file = folder / FILE
    data = read_json(file)
    workspace = workspace_of(data, file)
    entries = data.get("views")
    if not isinstance(entries, list):
        raise InputError(f"{file}: 'views' must be a list of views")
    if not 1 <= len(entries) <= MAX_VIEWS:
        raise InputError(f"{file}: {len(entries)} views given; a scene has 1 to {MAX_VIEWS} views")
    views = tuple(view_of(entry, f"{file}, view {i}", folder) for i, entry in enumerate(entries))
    scene = Views(views, workspace, source=str(folder.resolve()))
    check_scene(scene, str(file))
    return scene


def photo_files(path: str | Path) -> list[Path]:
    """The photos that the scene in folder `path` (or whose `scene.json` is `path`) names, if it is one:
    what must not be written over."""
    path = Path(path)
    folder = path.parent if path.name == FILE else path
    try:
        entries = read_json(folder / FILE).get("views")
    except InputError:
        return []
    photos = []
    for entry in _objects(entries):
        for key in ("image", "background"):
            with suppress(InputError):
                photos.append(photo_of(folder, entry, key, FILE))
    return photos


def write_scene(path: str | Path, views: Views) -> None:
    """Writes `views` as a scene into folder `path`. `scene.json` comes last and at once: a folder without it
    is not a scene yet. Raises `WriteError` where the disk refuses it."""
    path = Path(path)
    document = scene_document(views)
    for entry, view in zip(document["views"], views.frames, strict=True):
        for key, pixels in (("image", view.image), ("background", view.background)):
            target = path / entry[key]
            target.parent.mkdir(parents=True, exist_ok=True)
            Picture.fromarray(pixels).save(target, compress_level=4)
    write_text(path / FILE, json.dumps(document, indent=1))


def scene_document(views: Views) -> dict[str, Any]:
    """The content of `scene.json`, with names for the photos."""
    entries = []
    for i, view in enumerate(views.frames):
        entry: dict[str, Any] = {"image": f"images/{i}.png", "background": f"backgrounds/{i}.png"}
        entry["intrinsics"] = view.camera.intrinsics.tolist()
        entry["world_from_camera"] = view.camera.world_from_camera.tolist()
        if view.camera.sensed is not None:
            entry["sensed"] = [float(edge) for edge in view.camera.sensed]
        entries.append(entry)
    place = {
        "size": views.workspace.size,
        **views.workspace.unusual(),
        "world_from_workspace": views.workspace.world_from_workspace.tolist(),
    }
    return {"format": FORMAT, "version": VERSION, "workspace": place, "views": entries}


def read_json(file: Path) -> dict[str, Any]:
    """The content of `scene.json`, of a format and version that this program reads."""
    if not file.exists() and not file.is_symlink():
        raise InputError(f"{file}: missing; a scene is a folder with {FILE}, images/ and backgrounds/")
    return checked_head(read_object(file, "a scene"), file)


def checked_head(data: dict[str, Any], file: Path) -> dict[str, Any]:
    """The content of `file`, if it is a scene of a format and version that this program reads."""
    if data.get("format") != FORMAT:
        raise InputError(f'{file}: not a scene; it must be an object with "format": "{FORMAT}"')
    version = data.get("version")
    if isinstance(version, int) and version > VERSION:
        raise InputError(
            f"{file}: scene version {version} is newer than this program, which reads {VERSION}; "
            "update neugrasp"
        )
    if version != VERSION or isinstance(version, bool):
        raise InputError(f"{file}: unknown scene version {version!r}; this program reads {VERSION}")
    refuse_bends(data, SCENE_KEYS, str(file), STRAIGHT)
    warn_of_unknown([data], SCENE_KEYS, file, logger)
    warn_of_unknown(_objects([data.get("workspace")]), WORKSPACE_KEYS, f"{file}, workspace", logger)
    warn_of_unknown(_objects(data.get("views")), VIEW_KEYS, f"{file}, views", logger)
    return data


def _objects(values: Any) -> list[dict[str, Any]]:
    return [value for value in values if isinstance(value, dict)] if isinstance(values, list) else []


def workspace_of(data: dict[str, Any], file: Path) -> Workspace:
    """The cube and its place in the user's world."""
    entry = data.get("workspace")
    if not isinstance(entry, dict):
        raise InputError(f"{file}: 'workspace' must be an object with 'size' and 'world_from_workspace'")
    refuse_bends(entry, WORKSPACE_KEYS, f"{file}, workspace", STRAIGHT)
    size = float(numbers(entry.get("size"), (), f"{file}: workspace size"))
    if not EDGES[0] <= size <= EDGES[1]:
        guess = " (that looks like millimetres)" if EDGES[0] <= size / 1000 <= EDGES[1] else ""
        usual = f"the edge of the cube in metres, for the shipped weights {USUAL.size:.2f}"
        raise InputError(f"{file}: workspace size {size:g} m{guess}; it must be {usual}")
    pose = check_rigid(entry.get("world_from_workspace"), f"{file}: world_from_workspace")
    size = USUAL.size if np.isclose(size, USUAL.size, atol=1e-6) else size
    others = {name: entry[name] for name in ("resolution", "table_height", "truncation") if name in entry}
    cube = Workspace.from_dict({"size": size, **others}, f"{file}: workspace")
    return replace(cube, world_from_workspace=pose)


def view_of(entry: Any, where: str, folder: Path) -> View:
    """One entry of 'views' with its two photos loaded."""
    if not isinstance(entry, dict):
        raise InputError(f"{where}: must be an object with image, background, intrinsics, world_from_camera")
    refuse_bends(entry, VIEW_KEYS, where, STRAIGHT)
    image_file, background_file = (photo_of(folder, entry, key, where) for key in ("image", "background"))
    image, background = read_image(image_file, where), read_image(background_file, where)
    if image.shape != background.shape:
        raise InputError(
            f"{background_file}: background of {_size(background)}, image of {_size(image)}; "
            f"{where} needs both from the same camera at the same size"
        )
    return View(camera_of(entry, image, where), image, background, name=entry["image"])


def camera_of(entry: dict[str, Any], photo: Image, where: str) -> Camera:
    """The camera of an entry of 'views' that took a photo."""
    height, width = photo.shape[:2]
    _check_said_size(entry, photo, where)
    return Camera(
        check_intrinsics(entry.get("intrinsics"), width, height, f"{where}: intrinsics"),
        check_rigid(entry.get("world_from_camera"), f"{where}: world_from_camera"),
        width,
        height,
        check_sensed(entry.get("sensed"), width, height, f"{where}: sensed"),
    )


def _check_said_size(entry: dict[str, Any], image: Image, where: str) -> None:
    """Intrinsics are those of the photo as it is; a size beside them is of no use but to contradict that."""
    for key, value in entry.items():
        axis = SIZE_KEYS.get(plain(key))
        if axis is not None and value != image.shape[axis]:
            raise InputError(
                f"{where}: {key!r} is {str(value)[:20]}, the photo has {_size(image)}; give the intrinsics "
                "of the photo as it is on disk and leave the size away"
            )


def photo_of(folder: Path, entry: dict[str, Any], key: str, where: str) -> Path:
    """The file that `entry` names under `key`; only what really lies below the scene's folder is read."""
    name = entry.get(key)
    if not isinstance(name, str) or not name:
        raise InputError(f"{where}: {key!r} must be the path of a photo, relative to {FILE}")
    check_name(name, f"{where}: {key}")
    pure = PurePosixPath(name)
    if "\\" in name and not os.path.lexists(folder / pure):
        # Written on Windows; elsewhere a backslash is a letter.
        pure = PurePosixPath(name.replace("\\", "/"))
    if pure.is_absolute() or PureWindowsPath(name).is_absolute() or ".." in pure.parts:
        raise InputError(f"{where}: {key} {name!r} leaves the scene folder; copy the photo into the folder")
    file = folder / pure
    try:
        is_inside = file.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError) as error:
        raise InputError(f"{where}: {key} {name!r}: cannot be followed ({error})") from error
    if not is_inside:
        raise InputError(
            f"{where}: {key} {name!r} is a link that leaves the scene folder; copy the photo into the folder"
        )
    return file


def _size(image: Image) -> str:
    shape: Sequence[int] = image.shape
    return f"{shape[1]} x {shape[0]} pixels"
