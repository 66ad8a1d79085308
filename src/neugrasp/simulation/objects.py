"""The objects that scenes are made of: three sets behind one protocol, split into training and test."""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np

from neugrasp.errors import InputError, MissingExtra, ObjectError, told_as
from neugrasp.simulation.glassware import GlasswareSet
from neugrasp.simulation.meshes import merged, read_obj, write_obj
from neugrasp.simulation.object_model import ObjectModel, cache_folder, triple
from neugrasp.simulation.object_urdf import files_of, read_urdf

SPLITS = ("train", "test")
KINDS = ("single", "pile", "packed")


class ObjectSet(Protocol):
    """A named collection of objects whose training and test parts have nothing in common."""

    @property
    def name(self) -> str: ...

    def names(self, split: str, kind: str) -> tuple[str, ...]:
        """The objects of "train" or "test" that suit scenes of `kind`: "single", "pile" or "packed"."""
        ...

    def model(self, name: str) -> ObjectModel:
        """The object called `name`. Raises `InputError` where there is none or its files are unusable."""
        ...

    def content(self, name: str) -> bytes:
        """What the object called `name` was made from, as far as a user can change it."""
        ...


def _checked(split: str, kind: str) -> None:
    if split not in SPLITS or kind not in KINDS:
        raise InputError(f"no objects for split {split!r}, kind {kind!r}; choose from {SPLITS} and {KINDS}")


def stable_fraction(text: str) -> float:
    """A number in [0, 1) that depends on nothing but the text."""
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big") / 2**32


@dataclass(frozen=True)
class FolderSet:
    """URDFs of a user: packed/train, packed/test, pile/train, pile/test, or one flat folder split 80 / 20."""

    folder: Path
    name: str = "folder"

    def names(self, split: str, kind: str) -> tuple[str, ...]:
        """Names such as "pile/test/mug", relative to the folder and without ".urdf"."""
        _checked(split, kind)
        if not self._is_structured:
            return tuple(n for n in self._flat if (stable_fraction(n) < 0.8) == (split == "train"))
        parts = ("packed", "pile") if kind == "single" else (kind,)
        return tuple(f"{part}/{split}/{n}" for part in parts for n in _urdfs(self.folder / part / split))

    @cached_property
    def _is_structured(self) -> bool:
        if not self.folder.is_dir():
            raise InputError(f"{self.folder}: no such folder; --objects needs a folder of URDF files")
        return any((self.folder / kind / split).is_dir() for kind in ("packed", "pile") for split in SPLITS)

    @cached_property
    def _flat(self) -> tuple[str, ...]:
        names = _urdfs(self.folder)
        if not names:
            raise InputError(
                f"{self.folder}: holds neither NAME.urdf files nor packed/train, pile/train, ..."
            )
        return names

    def model(self, name: str) -> ObjectModel:
        """Mass and meshes as the URDF names them."""
        return read_urdf((self.folder / f"{name}.urdf"), name, self.folder)

    def content(self, name: str) -> bytes:
        """A hash of the URDF and of the meshes that it names."""
        content = hashlib.sha256()
        for file in files_of(self.folder / f"{name}.urdf", self.folder):
            content.update(file.read_bytes() if file.is_file() else b"missing")
        return content.digest()


def _urdfs(folder: Path) -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in folder.glob("*.urdf")))


@dataclass(frozen=True)
class PybulletSet:
    """The random objects that come with pybullet_data, shrunk to fit the gripper: 800 train, 200 test."""

    name: str = "pybullet"
    density: float = 400.0
    """Kilograms per cubic metre, from which masses follow."""

    def names(self, split: str, kind: str) -> tuple[str, ...]:
        """Three-digit numbers. 168 is left out: its file holds a vertex that is not a number."""
        _checked(split, kind)
        numbers = range(800) if split == "train" else range(800, 1000)
        return tuple(f"{number:03d}" for number in numbers if number != 168)

    def model(self, name: str) -> ObjectModel:
        """The object with its origin in its middle; its smaller horizontal width is at most 6.5 cm."""
        source = pybullet_data_folder() / "random_urdfs" / name / f"{name}.obj"
        parts = read_obj(source)
        whole = merged(parts)
        volume, centre = whole.volume_and_centroid()
        width = 0.03 + 0.035 * stable_fraction(f"pybullet {name}")
        scale = min(width / float(whole.extents[:2].min()), 0.15 / float(whole.extents.max()))
        path = cache_folder() / "pybullet-2" / f"{name}.obj"
        if not path.exists():
            write_obj(path, tuple(part.transformed(scale, -scale * whole.middle) for part in parts))
        mass = float(np.clip(volume * scale**3 * self.density, 0.01, 0.5))
        return ObjectModel(name, path, (path,), mass, centre_of_mass=triple(scale * (centre - whole.middle)))

    def content(self, name: str) -> bytes:
        """Nothing: the name says it all."""
        return b""


def pybullet_data_folder() -> Path:
    """The folder of the pybullet_data package, found without importing it."""
    spec = importlib.util.find_spec("pybullet_data")
    if spec is None or not spec.submodule_search_locations:
        raise MissingExtra("pybullet_data", "sim")
    return Path(spec.submodule_search_locations[0])


@dataclass(frozen=True)
class ObjectLibrary:
    """Several object sets opened together."""

    sets: tuple[ObjectSet, ...]
    _models: dict[tuple[str, str], ObjectModel] = field(default_factory=dict, repr=False, compare=False)

    @staticmethod
    @lru_cache(maxsize=8)
    def _open(sets: tuple[str, ...], folder: Path | None) -> ObjectLibrary:
        known = {"pybullet": PybulletSet, "glassware": GlasswareSet}
        opened: list[ObjectSet] = []
        for name in sets:
            if name == "folder":
                if folder is None:
                    raise InputError("the object set 'folder' needs a folder: --objects DIR")
                opened.append(FolderSet(folder))
            elif name in known:
                opened.append(known[name]())
            else:
                raise InputError(f"unknown object set {name!r}; choose from folder, {', '.join(known)}")
        return ObjectLibrary(tuple(opened))

    @classmethod
    @told_as(ObjectError)
    def open(cls, sets: Sequence[str], folder: str | Path | None = None) -> ObjectLibrary:
        """The named sets, each of "folder", "pybullet" and "glassware". Raises `ObjectError`."""
        if not sets or len(set(sets)) != len(sets):
            raise InputError(f"object sets {list(sets)}; name at least one, each once")
        return cls._open(tuple(sets), None if folder is None else Path(folder))

    def model(self, object_set: str, name: str) -> ObjectModel:
        """One object; its files are checked the first time it is asked for."""
        key = (object_set, name)
        if key not in self._models:
            chosen = [s for s in self.sets if s.name == object_set]
            if not chosen:
                raise InputError(
                    f"object set {object_set!r} is not open; open: {[s.name for s in self.sets]}"
                )
            self._models[key] = chosen[0].model(name)
        return self._models[key]

    def content_hash(self, objects: Iterable[tuple[str, str]]) -> str:
        """SHA-256 of objects (set, name): of their names, and of what a user's files of them hold."""
        sets = {some.name: some for some in self.sets}
        content = hashlib.sha256()
        for object_set, name in objects:
            content.update(f"{object_set} {name} ".encode() + sets[object_set].content(name))
        return content.hexdigest()

    def choices(self, split: str, kind: str) -> tuple[tuple[str, str], ...]:
        """All (object_set, name) that may stand in a scene, in a fixed order. Raises `InputError` if none."""
        found = tuple((s.name, name) for s in self.sets for name in s.names(split, kind))
        if not found:
            raise InputError(
                f"no objects for {split} scenes of kind {kind!r} in {[s.name for s in self.sets]}"
            )
        return found


@dataclass(frozen=True)
class OneFriction:
    """A library whose objects all have one friction."""

    library: ObjectLibrary
    friction: float

    def model(self, object_set: str, name: str) -> ObjectModel:
        """One object. Raises `InputError` as that of the library."""
        return replace(self.library.model(object_set, name), lateral_friction=self.friction)
