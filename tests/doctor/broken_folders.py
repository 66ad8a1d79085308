"""A good folder spoilt in one way at a time: what is wrong before any photo is compared."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image as Picture

from neugrasp.doctor import messages
from neugrasp.doctor.findings import Level, Problem


@dataclass(frozen=True)
class FolderCase:
    """One broken folder."""

    what: str
    spoil: Callable[[Path], None]
    problem: Problem
    level: Level
    views: tuple[int, ...] = ()
    is_mendable: bool = False


def scene(edit: Callable[[dict[str, Any]], None]) -> Callable[[Path], None]:
    """A change of scene.json."""

    def spoil(folder: Path) -> None:
        file = folder / "scene.json"
        data = json.loads(file.read_text())
        edit(data)
        file.write_text(json.dumps(data))

    return spoil


def posed(change: Callable[[np.ndarray], np.ndarray], views: tuple[int, ...]) -> Callable[[Path], None]:
    """A change of some poses."""

    def edit(data: dict[str, Any]) -> None:
        for i in views:
            entry = data["views"][i]
            entry["world_from_camera"] = change(np.array(entry["world_from_camera"])).tolist()

    return scene(edit)


def intrinsics(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    """A change of the intrinsics of all views."""

    def edit(data: dict[str, Any]) -> None:
        for entry in data["views"]:
            entry["intrinsics"] = change(np.array(entry["intrinsics"])).tolist()

    return scene(edit)


def smaller(folder: Path) -> None:
    """A background of another size."""
    file = folder / "backgrounds/3.png"
    with Picture.open(file) as picture:
        picture.resize((120, 68)).save(file)


def turned(folder: Path) -> None:
    """A photo as a phone stores it: the pixels lie on their side, a tag says so."""
    with Picture.open(folder / "images/0.png") as picture:
        tags = picture.getexif()
        tags[274] = 6
        picture.save(folder / "images/0.png", exif=tags)


def zoomed(folder: Path) -> None:
    """A photo that says that it was taken with a lens of twice the focal length."""
    with Picture.open(folder / "images/1.png") as picture:
        tags = picture.getexif()
        entry = json.loads((folder / "scene.json").read_text())["views"][1]
        film = entry["intrinsics"][0][0] * np.hypot(36, 24) / np.hypot(*picture.size)
        tags[0x8769] = {0xA405: round(2 * film)}
        picture.save(folder / "images/1.png", exif=tags)


RED = Level.RED
FOLDER_CASES = [
    FolderCase("scene.json missing", lambda f: (f / "scene.json").unlink(), messages.UNREADABLE, RED),
    FolderCase(
        "scene.json cut short",
        lambda f: (f / "scene.json").write_text('{"format":'),
        messages.UNREADABLE,
        RED,
    ),
    FolderCase("a photo missing", lambda f: (f / "images/1.png").unlink(), messages.UNREADABLE, RED, (1,)),
    FolderCase(
        "a photo damaged",
        lambda f: (f / "backgrounds/2.png").write_bytes(b"\x89PNG"),
        messages.UNREADABLE,
        RED,
        (2,),
    ),
    FolderCase("a background of another size", smaller, messages.UNREADABLE, RED, (3,)),
    FolderCase("a photo with a rotation tag", turned, messages.ROTATION_TAG, Level.YELLOW),
    FolderCase("a photo of a lens of twice the focal length", zoomed, messages.OTHER_LENS, Level.YELLOW),
    FolderCase(
        "a pose with a left-handed frame",
        posed(lambda p: p @ np.diag([1, 1, -1, 1]), (0,)),
        messages.NOT_RIGID,
        RED,
        (0,),
    ),
    FolderCase(
        "poses with a scale", posed(lambda p: p @ np.diag([2, 2, 2, 1]), (1,)), messages.NOT_RIGID, RED, (1,)
    ),
    FolderCase(
        "poses transposed", posed(np.transpose, (0, 1, 2, 3)), messages.TRANSPOSED, RED, (0, 1, 2, 3), True
    ),
    FolderCase(
        "size of the cube in millimetres",
        scene(lambda d: d["workspace"].update(size=300)),
        messages.UNITS,
        RED,
        (),
        True,
    ),
    FolderCase(
        "intrinsics in millimetres",
        intrinsics(lambda k: k * [[0.003], [0.003], [1]]),
        messages.INTRINSICS_UNIT,
        RED,
        (0, 1, 2, 3),
    ),
    FolderCase(
        "intrinsics as fractions of the photo",
        intrinsics(lambda k: k / [[240], [135], [1]]),
        messages.INTRINSICS_UNIT,
        RED,
        (0, 1, 2, 3),
    ),
    FolderCase(
        "the principal point missing",
        scene(lambda d: d["views"][2].update(intrinsics=[400, 400])),
        messages.UNREADABLE,
        RED,
        (2,),
    ),
]
