"""Grasps that were tried, beside the surface that a detector saw: what the evaluator of grasps learns from.

`Trials` tell what is true of a scene. Here the grid may be anything that stands for its surface, such as a
model's prediction from photos, and one file may hold several.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.npz import npz_arrays, npz_bytes
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import Workspace
from neugrasp.output import whole_file

COLUMNS: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
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


def read_lesson(path: Path) -> Lesson:
    """The inverse of `write_lesson`. Raises `InputError` naming the file where it is damaged."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    arrays = npz_arrays(data, KINDS, str(path))
    resolution, count = Workspace().resolution, len(arrays["success"])
    if arrays["grids"].shape[1:] != (resolution,) * 3:
        raise InputError(f"{path}: grids have the shape {arrays['grids'].shape}, not (g, 40, 40, 40)")
    for name, (kind, shape) in COLUMNS.items():
        if arrays[name].shape != (count, *shape) or arrays[name].dtype != kind:
            found = f"{arrays[name].dtype} {arrays[name].shape}"
            raise InputError(f"{path}: {name} is {found}; it must be {np.dtype(kind)} {(count, *shape)}")
    if count and arrays["seen"].max() >= len(arrays["grids"]):
        raise InputError(f"{path}: seen names number {arrays['seen'].max()} of {len(arrays['grids'])} grids")
    return Lesson(**arrays)
