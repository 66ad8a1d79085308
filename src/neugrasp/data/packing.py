"""Packing records into shards (`data/shards.py`)."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from neugrasp.data.captures import is_capture
from neugrasp.data.labels import LABELS_FILE, labels_to_bytes
from neugrasp.data.records import TRIALS_FILE, PhotosWanted, Record, read_record
from neugrasp.data.shards import FORMAT, IMAGES, INDEX, VERSION
from neugrasp.data.trials import trials_to_bytes
from neugrasp.data.truth_file import truth_to_bytes
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.data.world import camera_to_dict, scene_to_json
from neugrasp.errors import InputError
from neugrasp.observation import Image
from neugrasp.progress import counted

LIMIT = 60_000_000
"""Bytes; a shard never grows beyond it, unless a single record does."""


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
    found = [path.parent for folder in folders for path in sorted(Path(folder).glob(f"*/{LABELS_FILE}"))]
    if captures := [folder for folder in found if is_capture(folder)]:
        raise InputError(f"{captures[0]}: no simulator made it; scenes of a real cell are read as they are")
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
            "sha256": hashlib.sha256(members[f"{record.name}/{LABELS_FILE}"]).hexdigest()[:16],
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
    for group in IMAGES:
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
    members[f"{record.name}/truth.npz"] = truth_to_bytes(record.truth, record.stereo)
    members[f"{record.name}/{LABELS_FILE}"] = labels_to_bytes(record.labels)
    if record.trials is not None:
        members[f"{record.name}/{TRIALS_FILE}"] = trials_to_bytes(record.trials)
    return members


def _webp(image: Image, quality: int | None) -> bytes:
    stream = io.BytesIO()
    options = {"lossless": True, "quality": 60, "exact": True} if quality is None else {"quality": quality}
    Picture.fromarray(image).save(stream, "WEBP", method=4, **options)
    return stream.getvalue()
