"""Records packed into a few files for training: zip archives of at most 60 MB with WebP images.

An image that several records share, such as the background of a work cell, is stored once per shard.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from neugrasp.data.fields import Fields, shown
from neugrasp.data.labels import labels_from_bytes, labels_to_bytes
from neugrasp.data.npz import DAMAGE, reason_of
from neugrasp.data.records import (
    NO_PHOTOS,
    TRIALS_FILE,
    PhotosWanted,
    Record,
    check_record,
    read_record,
    without_photos,
)
from neugrasp.data.strict_json import parse_json, read_json
from neugrasp.data.trials import trials_from_bytes, trials_to_bytes
from neugrasp.data.truth_file import truth_from_bytes, truth_to_bytes
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.errors import InputError
from neugrasp.observation import Image
from neugrasp.progress import counted
from neugrasp.simulation.scene import camera_from_dict, camera_to_dict, scene_from_json, scene_to_json

FORMAT = "neugrasp-shards"
VERSION = 1
INDEX = "index.json"
LIMIT = 60_000_000
"""Bytes; a shard never grows beyond it, unless a single record does."""
LARGEST = 10 * LIMIT
"""Bytes that a member may unpack to."""
_IMAGES = ("images", "backgrounds", "targets", "target_backgrounds")


def pack(
    folders: Sequence[Path],
    out: Path,
    limit: int = LIMIT,
    quality: int | None = None,
    photos: PhotosWanted = "all",
) -> Path:
    """Packs every record found in `folders` into shards in `out`; the path of their index.

    Everything is kept exactly; or, with a `quality` (1 to 100), photos as lossy WebP, grids in steps of
    1/127, and neither depth nor masks, which no loss reads: a fraction of the bytes, to carry to a machine
    with a GPU. The same records give the same bytes. Raises `InputError` where there are none or two of one
    name.
    """
    found = [path.parent for folder in folders for path in sorted(Path(folder).glob("*/grasps.npz"))]
    names = [path.name for path in found]
    if not found:
        raise InputError(f"{', '.join(map(str, folders))}: no records here; generate some first")
    if doubled := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"record {doubled[0]!r} is in two of the folders; names must differ")
    earlier = sorted(path.name for path in out.glob("shard_*.zip"))
    with whole_or_nothing(out, (INDEX, *earlier)) as part:
        entries = [entry for shard in _shards(found, limit, quality, photos) for entry in shard.write(part)]
        index = {"format": FORMAT, "version": VERSION, "records": entries}
        (part / INDEX).write_text(json.dumps(index, indent=1), encoding="utf-8")
    return out / INDEX


@dataclass
class _Shard:
    """A shard being filled."""

    number: int
    members: dict[str, bytes] = field(default_factory=dict)
    entries: list[dict[str, Any]] = field(default_factory=list)

    def size(self, more: dict[str, bytes]) -> int:
        """Bytes of the archive with `more` members; each costs its name twice and two headers."""
        return sum(len(data) + 2 * len(name) + 160 for name, data in (self.members | more).items())

    def write(self, out: Path) -> list[dict[str, Any]]:
        """Writes the archive and gives the entries of the index."""
        file = f"shard_{self.number:04d}.zip"
        with zipfile.ZipFile(out / file, "w", zipfile.ZIP_STORED) as archive:
            for name, data in self.members.items():
                archive.writestr(zipfile.ZipInfo(name), data)
        return [{**entry, "shard": file} for entry in self.entries]


def _shards(
    folders: Sequence[Path], limit: int, quality: int | None, photos: PhotosWanted
) -> Iterator[_Shard]:
    shard = _Shard(0)
    for folder in counted(folders, "records"):
        record = read_record(folder, photos)
        if quality is not None:
            record = _light(record)
        members = _members(record, quality)
        if shard.entries and shard.size(members) > limit:
            yield shard
            shard = _Shard(shard.number + 1)
        shard.members.update(members)
        entry = {
            "name": record.name,
            "kind": record.kind,
            "materials": list(record.materials),
            "photos": record.has_photos,
            "sha256": hashlib.sha256(members[f"{record.name}/grasps.npz"]).hexdigest()[:16],
        }
        shard.entries.append(entry)
    yield shard


def _light(record: Record) -> Record:
    """The record with grids in steps of 1/127, and without depth and masks where no loss reads them: those of
    depth restoration do, which need stereo depth, too."""
    distance = None if record.distance is None else _rounded(record.distance)
    light = replace(record, tsdf=_rounded(record.tsdf), distance=distance)
    if record.stereo is not None:
        return light
    return replace(light, depths=np.zeros_like(record.depths), masks=np.zeros_like(record.masks))


def _rounded(grid: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.round(grid * 127).astype(np.float32) / 127


def _members(record: Record, quality: int | None) -> dict[str, bytes]:
    members: dict[str, bytes] = {}
    pictures: dict[str, list[str]] = {}
    for group in _IMAGES:
        pictures[group] = []
        for image in getattr(record, group):
            name = f"images/{hashlib.sha256(image.tobytes()).hexdigest()[:32]}.webp"
            members[name] = _webp(image, quality)
            pictures[group].append(name)
    description = {
        "scene": json.loads(scene_to_json(record.scene)),
        "cell": dict(record.cell),
        "cameras": [camera_to_dict(camera) for camera in record.cameras],
        "target_cameras": [camera_to_dict(camera) for camera in record.target_cameras],
        **pictures,
    }
    members[f"{record.name}/record.json"] = json.dumps(description).encode()
    members[f"{record.name}/truth.npz"] = truth_to_bytes(record)
    members[f"{record.name}/grasps.npz"] = labels_to_bytes(record.labels)
    if record.trials is not None:
        members[f"{record.name}/{TRIALS_FILE}"] = trials_to_bytes(record.trials)
    return members


def _webp(image: Image, quality: int | None) -> bytes:
    stream = io.BytesIO()
    options = {"lossless": True, "quality": 60, "exact": True} if quality is None else {"quality": quality}
    Picture.fromarray(image).save(stream, "WEBP", method=4, **options)
    return stream.getvalue()


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

    def identity(self) -> str:
        """A hash that changes when scenes are added, removed or made anew."""
        return hashlib.sha256(repr(self.entries).encode()).hexdigest()

    def __getitem__(self, index: Any) -> Any:
        """The record at `index`. Raises `InputError` naming the shard where it is damaged."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        return self.read(index)

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
    """Of its labels; None in an index of before this field."""


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
        labels=labels_from_bytes(_member(archive, f"{name}/grasps.npz"), source),
        trials=trials_from_bytes(_member(archive, file), source) if has_trials else None,
    )
    check_record(record, source)
    return record


def _seen(archive: zipfile.ZipFile, description: dict[str, Any], wanted: PhotosWanted) -> dict[str, Any]:
    """The fields of a `Record` that depend on its photos, but for depth and masks where there are photos."""
    found = without_photos()
    if wanted == "none" or not description["images"]:
        return found
    groups = _IMAGES if wanted == "all" else _IMAGES[:2]
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
