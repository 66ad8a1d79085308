"""Records packed into a few files for training: zip archives of at most 60 MB with WebP images.

An image that several records share, such as the background of a work cell, is stored once per shard.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image as Picture

from neugrasp.data.fields import Fields, shown
from neugrasp.data.grasp_scene import GraspScene
from neugrasp.data.labels import LABELS_FILE, labels_from_bytes
from neugrasp.data.npz import DAMAGE, reason_of
from neugrasp.data.records import (
    NO_PHOTOS,
    TRIALS_FILE,
    PhotosWanted,
    Record,
    check_record,
    without_photos,
)
from neugrasp.data.strict_json import parse_json, read_json
from neugrasp.data.trials import trials_from_bytes
from neugrasp.data.truth_file import truth_from_bytes
from neugrasp.data.world import camera_from_dict, scene_from_json
from neugrasp.errors import DataError, InputError, told_as
from neugrasp.observation import Image

FORMAT = "neugrasp-shards"
VERSION = 1
INDEX = "index.json"
LARGEST = 600_000_000
"""Bytes that a member may unpack to."""
IMAGES = ("images", "backgrounds", "targets", "target_backgrounds")


class Shards(Sequence[Record]):
    """Random access to packed records. Picklable: archives are opened when they are first read."""

    def __init__(self, folder: Path):
        """Raises `InputError` where the index is missing, damaged or of another version."""
        self.folder = Path(folder)
        path = self.folder / INDEX
        index = Fields(str(path), read_json(path, "an index made by `neugrasp pack`"))
        index.expect(FORMAT, VERSION)
        self.entries = tuple(_entry(fields) for fields in index.each("records"))
        self.names = tuple(entry.name for entry in self.entries)

    def __len__(self) -> int:
        return len(self.entries)

    def has_photos(self, index: int) -> bool:
        """Whether a record has photos, without reading it."""
        known = self.entries[index].photos
        return self.read(index).has_photos if known is None else known

    def has_truth(self, index: int) -> bool:
        """Whether a scene's surface is known: always, since only records of the simulator are packed."""
        return True

    def identity(self) -> str:
        """A hash that changes when scenes are added, removed or made anew."""
        return hashlib.sha256(repr(self.entries).encode()).hexdigest()

    def __getitem__(self, index: Any) -> Any:
        """The record at `index`. Raises `InputError` naming the shard where it is damaged."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        return self.read(index)

    def scene(self, index: int, photos: PhotosWanted = "all") -> GraspScene:
        """A scene to learn from. Raises like indexing."""
        return self.read(index, photos, trials=False).grasp_scene()

    @told_as(DataError)
    def read(self, index: int, photos: PhotosWanted = "all", trials: bool = True) -> Record:
        """The record at `index`, with what of photos and trials is wanted. Raises like indexing."""
        entry = self.entries[index]
        path = self.folder / entry.shard
        try:
            with zipfile.ZipFile(path) as archive:
                return _record(archive, entry.name, f"{path}, {entry.name}", photos, trials)
        except FileNotFoundError as error:
            raise InputError(
                f"{path}: missing; copy it beside the index or pack the records again"
            ) from error
        except (*DAMAGE, LookupError, AttributeError, Picture.DecompressionBombError) as error:
            reason = reason_of(error).removeprefix(f"{path}, {entry.name}: ")
            raise InputError(
                f"{path}: damaged at record {entry.name} ({reason}); copy or pack it again"
            ) from error


@dataclass(frozen=True)
class _Entry:
    """Where a record is."""

    name: str
    shard: str
    """The archive's name in the folder of the index."""
    photos: bool | None
    """Whether it has photos; None in an index of before this field."""
    sha256: str | None
    """Hash of its labels; None in an index of before this field."""


def _entry(fields: Fields) -> _Entry:
    name, shard = fields.text("name"), fields.text("shard")
    if not re.fullmatch(r"shard_\d+\.zip", shard):
        raise fields.refuse("shard", f"is {shown(shard)}; it must be shard_NUMBER.zip, beside the index")
    photos = fields.flag("photos") if "photos" in fields.data else None
    return _Entry(name, shard, photos, fields.text("sha256") if "sha256" in fields.data else None)


def _record(archive: zipfile.ZipFile, name: str, source: str, photos: PhotosWanted, trials: bool) -> Record:
    description = parse_json(_member(archive, f"{name}/record.json"), source)
    truth = truth_from_bytes(_member(archive, f"{name}/truth.npz"), source)
    file = f"{name}/{TRIALS_FILE}"
    has_trials = trials and file in archive.namelist()
    record = Record(
        name=name,
        scene=scene_from_json(json.dumps(description["scene"]), source),
        cell=Fields(source, description["cell"], "cell.").data,
        **(truth | _seen(archive, description, photos)),
        labels=labels_from_bytes(_member(archive, f"{name}/{LABELS_FILE}"), source),
        trials=trials_from_bytes(_member(archive, file), source) if has_trials else None,
    )
    check_record(record, source)
    return record


def _seen(archive: zipfile.ZipFile, description: dict[str, Any], wanted: PhotosWanted) -> dict[str, Any]:
    """The fields of a `Record` that depend on its photos, but for depth and masks where there are photos."""
    found = without_photos()
    if wanted == "none" or not description["images"]:
        return found
    groups = IMAGES if wanted == "all" else IMAGES[:2]
    cameras = {"cameras": description["cameras"]}
    if wanted == "all":
        cameras["target_cameras"] = description["target_cameras"]
    del found["depths"], found["masks"], found["stereo"]
    return (
        found
        | {name: tuple(camera_from_dict(camera) for camera in some) for name, some in cameras.items()}
        | {group: _stacked(archive, description[group]) for group in groups}
    )


def _member(archive: zipfile.ZipFile, name: str) -> bytes:
    size = archive.getinfo(name).file_size
    if size > LARGEST:
        raise ValueError(f"{name} unpacks to {size / 1e6:.0f} MB")
    return archive.read(name)


def _stacked(archive: zipfile.ZipFile, members: Sequence[str]) -> Image:
    images = [_image(archive, member) for member in members]
    return np.stack(images) if images else NO_PHOTOS


def _image(archive: zipfile.ZipFile, member: str) -> Image:
    # Reading a member checks its CRC, so that a flipped bit is an error rather than a wrong pixel.
    with Picture.open(io.BytesIO(_member(archive, member))) as picture:
        return np.asarray(picture.convert("RGB"))
