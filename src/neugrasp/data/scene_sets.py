"""Folders of scenes to learn from, read one at a time, whatever wrote them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from neugrasp.bucket import is_url
from neugrasp.data.captures import is_capture, read_capture
from neugrasp.data.grasp_scene import GraspScene
from neugrasp.data.labels import LABELS_FILE
from neugrasp.data.records import PhotosWanted, Record, read_record
from neugrasp.data.shards import INDEX, Shards
from neugrasp.errors import DataError, InputError, told_as


class SceneSet(Protocol):
    """Random access to the scenes of a folder."""

    def __len__(self) -> int: ...

    def scene(self, index: int, photos: PhotosWanted = "all") -> GraspScene:
        """A scene to learn from, with what of its photos is wanted."""
        ...

    def read(self, index: int, photos: PhotosWanted = "all", trials: bool = True) -> Record:
        """The simulator's record of a scene. Raises `InputError` where no simulator made it."""
        ...

    def has_photos(self, index: int) -> bool:
        """Whether a scene has photos, without reading it."""
        ...

    def has_truth(self, index: int) -> bool:
        """Whether a scene's surface is known, without reading it."""
        ...

    def identity(self) -> str:
        """A hash that changes when scenes are added, removed or made anew."""
        ...


class SceneFolder:
    """What `neugrasp generate` wrote, or scenes of a real cell, or both."""

    def __init__(self, folder: Path):
        """Raises `InputError` where there are no scenes."""
        if is_url(folder):
            raise InputError(f"{folder}: is in an object store; copy it into a folder and give that")
        found = sorted(folder.rglob(LABELS_FILE))
        self.folders = [path.parent for path in found if ".tmp" not in str(path)]
        if not self.folders:
            raise InputError(f"{folder}: no scenes to learn from; `neugrasp generate` makes some")

    def __len__(self) -> int:
        return len(self.folders)

    def scene(self, index: int, photos: PhotosWanted = "all") -> GraspScene:
        """A scene to learn from, with what of its photos is wanted."""
        folder = self.folders[index]
        if is_capture(folder):
            return read_capture(folder, targets=photos == "all")
        return read_record(folder, photos, trials=False).grasp_scene()

    def read(self, index: int, photos: PhotosWanted = "all", trials: bool = True) -> Record:
        """The simulator's record of a scene. Raises `InputError` where no simulator made it."""
        folder = self.folders[index]
        if is_capture(folder):
            raise InputError(f"{folder}: no simulator made it; this needs scenes of `neugrasp generate`")
        return read_record(folder, photos, trials)

    def has_photos(self, index: int) -> bool:
        """Whether a scene has photos, without reading it."""
        return (self.folders[index] / "scene.json").is_file()

    def has_truth(self, index: int) -> bool:
        """Whether a scene's surface is known, without reading it."""
        return not is_capture(self.folders[index])

    def identity(self) -> str:
        """A hash that changes when scenes are added, removed or made anew."""
        facts = [
            (folder.name, [path.stat().st_size for name in _MARKS if (path := folder / name).is_file()])
            for folder in self.folders
        ]
        return hashlib.sha256(repr(facts).encode()).hexdigest()


_MARKS = ("truth.npz", LABELS_FILE)
"""Files whose sizes tell one making of a scene from another."""


@told_as(DataError)
def open_scenes(folder: Path) -> SceneSet:
    """The scenes in a folder of shards, in one that `neugrasp generate` wrote, or of a real cell.

    Raises `DataError` where there are none.
    """
    return Shards(folder) if (folder / INDEX).is_file() else SceneFolder(folder)


def read_records(folder: Path) -> Iterator[Record]:
    """Every record of the simulator in a folder, one after the other, without its trials.

    Raises `InputError` where one is damaged or was not made by the simulator.
    """
    scenes = open_scenes(folder)
    return (scenes.read(index, trials=False) for index in range(len(scenes)))
