"""A folder of photos, searched by the names that other programs gave them."""

from __future__ import annotations

import logging
import os
import re
import unicodedata
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath

from neugrasp.data.photo_files import FOREIGN
from neugrasp.data.user_files import check_name
from neugrasp.errors import InputError

SUFFIXES = (".png", ".jpg", ".jpeg", ".jpe", ".jfif")
UNKNOWN_SUFFIX = re.compile(r"\.[a-z][a-z0-9]{1,6}$")
IPHONE = " (iPhone: Settings, Camera, Formats, Most Compatible)"

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class PhotoFolder:
    """All photos of a folder and of those in it; pipes, hidden files and what is no photo are left out."""

    path: Path
    is_closed: bool = False
    """Whether links that leave the folder are refused."""

    def find(self, name: str) -> Path | None:
        """The photo of a name, with as many of the name's own folders as there are here, and with any suffix.

        The folder is never left: what leads upwards or is absolute in the name counts for nothing. Raises
        `InputError` where several files may be meant.
        """
        parts = parts_of(name)
        # A suffix that nobody knows may be part of the name, and is taken away only where that finds nothing.
        for strip in (key_of, lambda name: UNKNOWN_SUFFIX.sub("", key_of(name))):
            for first in range(len(parts)):
                tail = "/".join(parts[first:])
                if found := self._index.get(strip(tail)):
                    return self._checked(_best(tail, found, self.path))
        return None

    @property
    def photos(self) -> list[Path]:
        """All of them, in the order of their names."""
        return sorted(self.path / file for files in self._index.values() for file in files)

    def names(self) -> list[str]:
        """The names of the photos in the folder itself. Raises `InputError` where there is none."""
        names = sorted(file.name for file in self.photos if file.parent == self.path)
        if not names:
            raise InputError(
                f"{self.path}: no photos; it must hold .png or .jpg files{self.foreign_hint(self._foreign)}"
            )
        if left_out := [name for name in self._foreign if key_of(name) not in self._index]:
            logger.warning("%s: %s left out%s", self.path, left_out[0], self.foreign_hint(left_out))
        return names

    def foreign_hint(self, names: Iterable[str]) -> str:
        """What to do about photos of these names that are there as files of another kind; empty without."""
        keys = {
            key_of("/".join(parts[first:])) for parts in map(parts_of, names) for first in range(len(parts))
        }
        kinds = sorted({FOREIGN[Path(file).suffix.lower()] for file in self._foreign if key_of(file) in keys})
        if not kinds:
            return ""
        return (
            f": it holds {', '.join(kinds)} files, which are not read; convert photos and backgrounds to "
            "JPEG or PNG" + (IPHONE if "HEIC" in kinds else "")
        )

    def has_of_another_kind(self, name: str) -> bool:
        """Whether something is there under the name of a photo, in any folder, that is not read."""
        parts = parts_of(name)
        keys = {key_of("/".join(parts[first:])) for first in range(len(parts))}
        return any(key_of(file) in keys for file in (*self._foreign, *self._unreadable))

    @cached_property
    def _unreadable(self) -> list[str]:
        """Pipes, devices, and links that lead nowhere, under the names of photos."""
        return [n for n in _files(self.path) if is_photo(Path(n)) and not (self.path / n).is_file()]

    @cached_property
    def _index(self) -> dict[str, list[str]]:
        """Relative paths by their key, hidden files and what is no regular file left out."""
        index: dict[str, list[str]] = {}
        for name in _files(self.path):
            if is_photo(Path(name)) and (self.path / name).is_file():
                index.setdefault(key_of(name), []).append(name)
        return index

    @cached_property
    def _foreign(self) -> list[str]:
        return [name for name in _files(self.path) if Path(name).suffix.lower() in FOREIGN]

    def _checked(self, file: Path) -> Path:
        if self.is_closed and not file.resolve().is_relative_to(self.path.resolve()):
            raise InputError(f"{file}: is a link that leaves the folder; copy the photo into it")
        return file


def is_photo(file: Path) -> bool:
    """Whether the name of a file is that of a photo."""
    return file.suffix.lower() in SUFFIXES and not file.name.startswith(".")


def parts_of(name: str) -> list[str]:
    """The folders and the file of a name, of Windows, too, without drive and root; what leads upwards takes a
    folder away where there is one. Raises `InputError` where nothing is left."""
    check_name(name, "a photo")
    parts: list[str] = []
    for part in PurePosixPath(name.replace("\\", "/")).parts:
        if part == "..":
            del parts[-1:]
        elif part != "/" and not (part.endswith(":") and len(part) == 2):
            parts.append(part.strip("/"))
    if not parts:
        raise InputError(f"{name!r} is no name of a photo")
    return parts


def _without_suffix(name: str) -> str:
    pure = PurePosixPath(name)
    is_picture = pure.suffix.lower() in (*SUFFIXES, *FOREIGN)
    return name[: -len(pure.suffix)] if is_picture else name


def key_of(name: str) -> str:
    """What the names of one photo have in common, whatever its suffix, capitals and the way of accents."""
    return unicodedata.normalize("NFC", _without_suffix(name)).casefold()


def _best(name: str, found: list[str], folder: Path) -> Path:
    """The file that is most like the name. Raises `InputError` where two are."""
    if name in found:
        return folder / name
    stem, suffix = _without_suffix(name), Path(name).suffix.lower()
    for is_alike in (
        lambda file: _without_suffix(file) == stem and Path(file).suffix.lower() == suffix,
        lambda file: Path(file).suffix.lower() == suffix,
        lambda file: _without_suffix(file) == stem,
        lambda file: True,
    ):
        alike = [file for file in found if is_alike(file)]
        if len(alike) == 1:
            return folder / alike[0]
        if alike:
            break
    raise InputError(
        f"{folder}: {name!r} may be {' or '.join(sorted(alike))}; keep one of them, or give it a name of "
        "its own"
    )


def _files(folder: Path) -> Iterator[str]:
    """Relative paths of all files, with / between folders; links to folders are followed once."""
    seen: set[str] = set()
    for place, folders, files in os.walk(folder, followlinks=True):
        real = os.path.realpath(place)
        if real in seen:
            folders.clear()
            continue
        seen.add(real)
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        relative = Path(place).relative_to(folder)
        yield from ((relative / name).as_posix() for name in sorted(files))
