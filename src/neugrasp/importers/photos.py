"""Which file is the photo of a view, and which the photo of the empty table."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from neugrasp.errors import InputError
from neugrasp.importers.photo_folder import PhotoFolder, is_photo, key_of, parts_of

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Pair:
    """The two photos of a view."""

    image: Path
    background: Path


@dataclass(frozen=True)
class Photos:
    """Two folders in which photos of the same name, whatever the suffix, belong together."""

    images: PhotoFolder
    backgrounds: PhotoFolder
    chosen: tuple[str, ...] = ()
    """Names of the photos to use, with or without folder and suffix; by default all with a background."""
    beside: tuple[Path, ...] = ()
    """Folders from which absolute names, and those that lead upwards, are followed; none to keep to "
    "`images`."""
    is_relative: bool = False
    """Whether every name is followed from there first, as in transforms.json."""

    def pairs(self, names: Sequence[str]) -> dict[str, Pair]:
        """Image and background of each of `names` that has both, in order: as chosen, or by name.

        Raises `InputError` where a chosen one is not there, where there is none at all, and where two names
        lead to one file.
        """
        if self.chosen:
            found = {name: self._pair(name, names) for name in self._chosen(names)}
        else:
            found = {
                name: Pair(image, background)
                for name in sorted(set(names))
                if (background := self.backgrounds.find(name)) is not None
                and (image := self.image_of(name)) is not None
            }
        if not found:
            raise InputError(self._nothing(names))
        return _unique(found)

    def image_of(self, name: str) -> Path | None:
        """The photo of a name: where the name itself leads, or of that name in the folder of the photos."""
        if self.is_relative or leads_away(name):
            places = (place / name.replace("\\", "/") for place in self.beside)
            if meant := next(filter(_is_there, places), None):
                return meant
        return self.images.find(name)

    def tell_of_strangers(self, names: Iterable[str]) -> None:
        """Warns of backgrounds whose photo has no pose: a reconstruction may have left it out."""
        known = {_found(self.backgrounds.find, name) for name in names}
        strangers = [str(file.relative_to(self.backgrounds.path)) for file in self.backgrounds.photos]
        strangers = [name for name in strangers if self.backgrounds.path / name not in known]
        if strangers:
            logger.warning(
                "%s: no pose is known for %s; left out", self.backgrounds.path, shortened(strangers)
            )

    def tell_of_lost(self, names: Iterable[str]) -> None:
        """Warns of photos that are left out although their fellow is there: files of another kind, pipes,
        links that lead nowhere. Most photos of a reconstruction have no background, and need none."""
        listed = list(names)
        for folder, find, of_fellow in (
            (self.images, self.image_of, self.backgrounds.find),
            (self.backgrounds, self.backgrounds.find, self.image_of),
        ):
            lost = [n for n in listed if _found(find, n) is None and _found(of_fellow, n) is not None]
            if folder is self.backgrounds:
                lost = [name for name in lost if folder.has_of_another_kind(name)]
            if lost:
                hint = folder.foreign_hint(lost) or ": there is none that can be read"
                logger.warning("%s: %s left out%s", folder.path, shortened(lost), hint)

    def _chosen(self, names: Sequence[str]) -> list[str]:
        """The full names of the chosen photos."""
        full = []
        for word in self.chosen:
            parts = parts_of(word)
            fitting = (
                [name for name in names if name == word]
                or [name for name in names if parts_of(name)[-len(parts) :] == parts]
                or [name for name in names if _alike(parts_of(name)[-len(parts) :], parts)]
            )
            if len(set(fitting)) != 1:
                found = "no photo" if not fitting else f"{len(fitting)} photos"
                hint = f": {shortened(fitting)}; name the folder, too" if fitting else ""
                raise InputError(
                    f"--views {word}: {found} of that name; there are {shortened(sorted(names))}{hint}"
                )
            if fitting[0] in full:
                raise InputError(f"--views {word}: {fitting[0]} is named twice; name each photo once")
            full.append(fitting[0])
        return full

    def _pair(self, name: str, names: Sequence[str]) -> Pair:
        image, background = self.image_of(name), self.backgrounds.find(name)
        for file, folder, what in (
            (image, self.images, "photo"),
            (background, self.backgrounds, "background"),
        ):
            if file is None:
                raise InputError(f"{folder.path}: no {what} {name}{folder.foreign_hint([name])}")
        assert image is not None
        assert background is not None
        for file, find in ((image, self.image_of), (background, self.backgrounds.find)):
            if rival := next((n for n in names if n != name and _found(find, n) == file), None):
                raise InputError(
                    f"{file}: stands for both {name} and {rival}; put it into a folder of the same name as "
                    "in the photo's name"
                )
        return Pair(image, background)

    def _nothing(self, names: Sequence[str]) -> str:
        for folder in (self.images, self.backgrounds):
            if hint := folder.foreign_hint(names):
                return f"{folder.path}: none of the photos {shortened(names)} can be read{hint}"
        return (
            f"none of the photos {shortened(names)} is in {self.images.path} and has a background of the "
            f"same name in {self.backgrounds.path}; name the folders with --images and --backgrounds"
        )


def shortened(names: Iterable[str]) -> str:
    """The first few names."""
    words = list(names)
    return ", ".join(words[:8]) + (f", ... ({len(words)} in all)" if len(words) > 8 else "")


def _alike(one: list[str], other: list[str]) -> bool:
    """Whether two names are one but for suffix and capitals."""
    return key_of("/".join(one)) == key_of("/".join(other))


def leads_away(name: str) -> bool:
    """Whether a name is absolute or leads upwards."""
    pure = PurePosixPath(name.replace("\\", "/"))
    return pure.is_absolute() or ".." in pure.parts


def _is_there(file: Path) -> bool:
    try:
        return is_photo(file) and file.is_file()
    except (OSError, ValueError):
        return False


def _found(find: Callable[[str], Path | None], name: str) -> Path | None:
    """What is found for a name that nobody asked for: nothing where several files may be meant."""
    try:
        return find(name)
    except InputError:
        return None


def _unique(pairs: dict[str, Pair]) -> dict[str, Pair]:
    """The pairs. Raises `InputError` where two photos are one file."""
    names: dict[Path, str] = {}
    for name, pair in pairs.items():
        if pair.image.resolve() == pair.background.resolve():
            raise InputError(
                f"{pair.image}: is the photo {name} and its background at once; --backgrounds names the "
                "folder with the photos of the empty table"
            )
        for file in (pair.image, pair.background):
            other = names.setdefault(file.resolve(), name)
            if other != name:
                raise InputError(
                    f"{file}: stands for both {other} and {name}; photos need names of their own, or "
                    "folders of the same names"
                )
    return pairs
