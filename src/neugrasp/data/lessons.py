"""Grasps that were tried, beside the surface that a detector saw: what the evaluator of grasps learns from.

`Trials` tell what is true of a scene. Here the grid may be anything that stands for its surface, such as a
model's prediction from photos, and one file may hold several.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.fields import Fields
from neugrasp.data.npz import Columns, check_columns, npz_arrays, npz_bytes
from neugrasp.data.strict_json import read_json
from neugrasp.data.user_files import read_bytes
from neugrasp.errors import DataError, InputError, told_as
from neugrasp.geometry.workspace import USUAL
from neugrasp.gripper import Gripper
from neugrasp.output import whole_file

ABOUT = "lessons.json"
"""In a folder of lessons: what all of them have in common."""
FORMAT, VERSION = "neugrasp-lessons", 2
COLUMNS: Columns = {
    "positions": (np.float32, (3,)),
    "quaternions": (np.float32, (4,)),
    "success": (np.bool_, ()),
    "free": (np.bool_, ()),
    "seen": (np.uint8, ()),
}
"""The type of a column and the shape of a trial's entry in it."""
KINDS = {name: np.dtype(kind).kind for name, (kind, _) in COLUMNS.items()} | {"grids": "f"}


@dataclass(frozen=True)
class Lesson:
    """k grasps that were executed from rest, and the grids in which a detector might have found them."""

    grids: NDArray[np.float16]
    """(g, r, r, r) in [-1, 1], indexed [x, y, z] in the workspace frame: 0 surface, + outside."""
    positions: NDArray[np.float32]
    """(k, 3) the TCP in the workspace frame, metres."""
    quaternions: NDArray[np.float32]
    """(k, 4) `workspace_from_grasp`, xyzw."""
    success: NDArray[np.bool_]
    """(k,)"""
    free: NDArray[np.bool_]
    """(k,) whether the hand came to the grasp without touching anything."""
    seen: NDArray[np.uint8]
    """(k,) index into `grids`."""

    def __len__(self) -> int:
        return len(self.success)


def joined(lessons: list[Lesson]) -> Lesson:
    """All in one, with grids renumbered. Needs at least one; at most 256 grids in all."""
    starts = np.cumsum([0, *(len(lesson.grids) for lesson in lessons)])
    columns = {name: np.concatenate([getattr(each, name) for each in lessons]) for name in COLUMNS}
    columns["seen"] = np.concatenate(
        [each.seen.astype(np.int64) + start for each, start in zip(lessons, starts, strict=False)]
    ).astype(np.uint8)
    return Lesson(np.concatenate([lesson.grids for lesson in lessons]), **columns)


def write_lesson(path: Path, lesson: Lesson) -> None:
    """Writes the file whole or not at all."""
    columns = {name: getattr(lesson, name).astype(kind) for name, (kind, _) in COLUMNS.items()}
    with whole_file(path) as part:
        part.write_bytes(npz_bytes(grids=lesson.grids.astype(np.float16), **columns))


@told_as(DataError)
def read_lesson(path: Path) -> Lesson:
    """The inverse of `write_lesson`. Raises `DataError` naming the file where it is damaged."""
    try:
        data = read_bytes(path)
    except FileNotFoundError:
        raise InputError(f"{path}: missing; a lesson is needed") from None
    arrays = npz_arrays(data, KINDS, str(path))
    resolution, count = USUAL.resolution, len(arrays["success"])
    if arrays["grids"].shape[1:] != (resolution,) * 3:
        raise InputError(f"{path}: grids have the shape {arrays['grids'].shape}, not (g, 40, 40, 40)")
    check_columns(arrays, COLUMNS, count, str(path))
    if count and arrays["seen"].max() >= len(arrays["grids"]):
        raise InputError(f"{path}: seen names number {arrays['seen'].max()} of {len(arrays['grids'])} grids")
    return Lesson(**arrays)


def about_lessons(gripper: Gripper) -> dict[str, Any]:
    """What stands in `ABOUT`: the gripper that tried, as in its file."""
    return {"format": FORMAT, "version": VERSION, "gripper": gripper.to_dict()}


def gripper_of(folder: Path) -> Gripper:
    """With what all lessons of a folder were tried. Raises `InputError` where the folder does not say."""
    told = Fields(f"{folder / ABOUT}", read_json(folder / ABOUT, "what lessons have in common"))
    told.expect(FORMAT, VERSION)
    return Gripper.from_dict(told.inside("gripper"))
