"""Which file is the photo of a view, and which the photo of the empty table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from neugrasp.errors import InputError

SUFFIXES = (".png", ".jpg", ".jpeg")


@dataclass(frozen=True)
class Pair:
    """The two photos of a view."""

    image: Path
    background: Path


@dataclass(frozen=True)
class Photos:
    """Two folders in which photos of the same name, whatever the suffix, belong together."""

    images: Path
    backgrounds: Path
    chosen: tuple[str, ...] = ()
    """Names of the photos to use, with or without folder and suffix; by default all with a background."""

    def pairs(self, names: Sequence[str]) -> dict[str, Pair]:
        """Image and background of each of `names` that has both, in order: as chosen, or by name.

        Raises `InputError` where a chosen one is not there, where there is none at all, and where two names
        lead to one file.
        """
        if self.chosen:
            return _unique({name: self._pair(name) for name in self._chosen(names)})
        found = {}
        for name in sorted(names):
            image, background = find(self.images, name), find(self.backgrounds, name)
            if image is not None and background is not None:
                found[name] = Pair(image, background)
        if not found:
            raise InputError(
                f"none of the photos {shortened(names)} is in {self.images} and has a background of the same "
                f"name in {self.backgrounds}; name the folders with --images and --backgrounds"
            )
        return _unique(found)

    def _chosen(self, names: Sequence[str]) -> list[str]:
        """The full names of the chosen photos."""
        full = []
        for word in self.chosen:
            fitting = [name for name in names if word in (name, PurePosixPath(name).name, stem_of(name))]
            if len(fitting) != 1:
                found = "no photo" if not fitting else f"{len(fitting)} photos"
                raise InputError(
                    f"--views {word}: {found} of that name; there are {shortened(sorted(names))}"
                )
            full.append(fitting[0])
        return full

    def _pair(self, name: str) -> Pair:
        files = []
        for folder, what in ((self.images, "photo"), (self.backgrounds, "background")):
            file = find(folder, name)
            if file is None:
                raise InputError(f"{folder}: no {what} {name}")
            files.append(file)
        return Pair(*files)


def photo_names(folder: Path) -> list[str]:
    """The names of the photos in a folder. Raises `InputError` where there is none."""
    names = sorted(file.name for file in folder.iterdir() if is_photo(file)) if folder.is_dir() else []
    if not names:
        raise InputError(f"{folder}: no photos; it must hold .png or .jpg files")
    return names


def is_photo(file: Path) -> bool:
    """Whether the name of a file is that of a photo."""
    return file.suffix.lower() in SUFFIXES and not file.name.startswith(".")


def find(folder: Path, name: str) -> Path | None:
    """The photo `name` in a folder, with or without the folders in the name, and with any suffix."""
    pure = PurePosixPath(name.replace("\\", "/"))
    for place in (folder / pure, folder / pure.name):
        if is_photo(place) and place.is_file():
            return place
        stem = place.with_suffix("") if is_photo(place) else place
        for suffix in (*SUFFIXES, *(suffix.upper() for suffix in SUFFIXES)):
            candidate = stem.with_name(stem.name + suffix)
            if candidate.is_file():
                return candidate
    return None


def stem_of(name: str) -> str:
    """The name of a photo without folder and suffix."""
    pure = PurePosixPath(name)
    return pure.stem if is_photo(Path(name)) else pure.name


def shortened(names: Iterable[str]) -> str:
    """The first few names."""
    words = list(names)
    return ", ".join(words[:8]) + (f", ... ({len(words)} in all)" if len(words) > 8 else "")


def _unique(pairs: dict[str, Pair]) -> dict[str, Pair]:
    """The pairs. Raises `InputError` where two of them share a file."""
    names: dict[Path, str] = {}
    for name, pair in pairs.items():
        for file in (pair.image, pair.background):
            if file in names:
                raise InputError(
                    f"{file}: stands for both {names[file]} and {name}; photos need names of their own"
                )
            names[file] = name
    return pairs
