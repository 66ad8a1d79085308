"""Objects that the project makes itself: hollow glassware, and boxes and cans beside it, from a number."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array
from neugrasp.simulation import lathe
from neugrasp.simulation.lathe import Vessel
from neugrasp.simulation.meshes import Mesh, write_obj
from neugrasp.simulation.object_model import ObjectModel, cache_folder, triple

GLASS_DENSITY = 2500.0
"""Kilograms per cubic metre."""
PACKAGE_DENSITY = 500.0
NUM_TRAIN = 200
NUM_TEST = 50
_MASS_LIMITS = (0.02, 0.4)

Heights = Callable[[Array], Array]


@dataclass(frozen=True)
class Solid:
    """An object about to be written: its surface and the convex parts that stand for it in contact."""

    surface: Mesh
    convex: tuple[Mesh, ...]
    density: float


@dataclass(frozen=True)
class GlasswareSet:
    """Bottles, tumblers, stemmed glasses, bowls, jars, boxes and cans: 200 train, 50 test, by number."""

    name: str = "glassware"

    def names(self, split: str, kind: str) -> tuple[str, ...]:
        """Family and number, such as "tumbler_008"; every kind of scene may hold every object."""
        if split not in ("train", "test"):
            raise InputError(f"no glassware for split {split!r}; choose train or test")
        numbers = range(NUM_TRAIN) if split == "train" else range(NUM_TRAIN, NUM_TRAIN + NUM_TEST)
        return tuple(f"{_FAMILY_NAMES[n % len(FAMILIES)]}_{n:03d}" for n in numbers)

    def model(self, name: str) -> ObjectModel:
        """The object, with its origin in its middle; meshes are written once into the cache."""
        if name not in self.names("train", "pile") + self.names("test", "pile"):
            raise InputError(
                f"no glassware called {name!r}; names are like {self.names('train', 'pile')[0]!r}"
            )
        solid = make(name)
        volume, centre = solid.surface.volume_and_centroid()
        middle = solid.surface.middle
        visual, collision = (
            cache_folder() / "glassware-2" / f"{name}_{part}.obj" for part in ("visual", "collision")
        )
        if not visual.exists():
            write_obj(visual, (solid.surface.transformed(1.0, -middle),))
        if not collision.exists():
            write_obj(collision, tuple(part.transformed(1.0, -middle) for part in solid.convex))
        mass = float(np.clip(volume * solid.density, *_MASS_LIMITS))
        return ObjectModel(name, visual, (collision,), mass, centre_of_mass=triple(centre - middle))

    def content(self, name: str) -> bytes:
        """Nothing: the name says it all."""
        return b""


def make(name: str) -> Solid:
    """The object called `name`, standing on z = 0 about the z axis, metres."""
    family, number = name.rsplit("_", 1)
    return FAMILIES[family](np.random.default_rng([20250, int(number)]))


def _vessel(vessel: Vessel) -> Solid:
    return Solid(lathe.surface(vessel), lathe.convex_parts(vessel), GLASS_DENSITY)


def _tumbler(rng: np.random.Generator) -> Solid:
    top, height = rng.uniform(0.025, 0.035), rng.uniform(0.07, 0.13)
    bottom, floor = top * rng.uniform(0.75, 1.0), rng.uniform(0.004, 0.01)
    bulge = rng.uniform(0.0, 0.08) * top

    def radius(z: Array) -> Array:
        s = z / height
        return bottom + (top - bottom) * s + bulge * np.sin(np.pi * s)

    return _vessel(Vessel(((bottom, 0.0),), radius, floor, height, rng.uniform(0.002, 0.0035)))


def _bottle(rng: np.random.Generator) -> Solid:
    body, height = rng.uniform(0.022, 0.033), rng.uniform(0.11, 0.16)
    neck, start = body * rng.uniform(0.4, 0.55), height * rng.uniform(0.5, 0.62)
    end = start + height * rng.uniform(0.16, 0.24)

    def radius(z: Array) -> Array:
        s = np.clip((z - start) / (end - start), 0, 1)
        return body + (neck - body) * s * s * (3 - 2 * s)

    floor = rng.uniform(0.004, 0.008)
    return _vessel(Vessel(((body, 0.0),), radius, floor, height, rng.uniform(0.002, 0.003), (start, end)))


def _jar(rng: np.random.Generator) -> Solid:
    body, height = rng.uniform(0.026, 0.036), rng.uniform(0.06, 0.11)
    mouth, start = body * rng.uniform(0.75, 0.9), height * 0.72
    end = height * 0.86

    def radius(z: Array) -> Array:
        s = np.clip((z - start) / (end - start), 0, 1)
        return body + (mouth - body) * s * s * (3 - 2 * s)

    floor = rng.uniform(0.004, 0.007)
    return _vessel(Vessel(((body, 0.0),), radius, floor, height, rng.uniform(0.0025, 0.0035), (start, end)))


def _stemmed(rng: np.random.Generator) -> Solid:
    foot, stem, stem_top = rng.uniform(0.026, 0.033), rng.uniform(0.004, 0.0055), rng.uniform(0.04, 0.06)
    belly, depth = rng.uniform(0.024, 0.034), rng.uniform(0.05, 0.07)
    widest, lip = rng.uniform(0.5, 0.9), rng.uniform(0.8, 1.0)

    def radius(z: Array) -> Array:
        s = np.clip((z - stem_top) / depth, 0, 1)
        rising = np.sqrt(np.clip(1 - (1 - np.minimum(s / widest, 1) * 0.97 - 0.03) ** 2, 0, 1))
        falling = 1 - (1 - lip) * np.clip((s - widest) / (1 - widest), 0, 1) ** 2
        return stem * 1.2 + (belly - stem * 1.2) * rising * falling

    base = ((foot, 0.0), (foot, 0.0015), (stem * 1.3, 0.006), (stem, 0.012), (stem, stem_top - 0.004))
    floor = stem_top + 0.003
    return _vessel(Vessel(base, radius, floor, stem_top + depth, rng.uniform(0.0015, 0.0025), segments=5))


def _bowl(rng: np.random.Generator) -> Solid:
    rim, height = rng.uniform(0.045, 0.065), rng.uniform(0.035, 0.055)
    foot = rim * rng.uniform(0.4, 0.55)
    roundness = rng.uniform(1.6, 2.2)

    def radius(z: Array) -> Array:
        s = np.clip(z / height, 0, 1)
        return foot + (rim - foot) * (1 - (1 - s) ** roundness) ** (1 / roundness)

    return _vessel(Vessel(((foot, 0.0),), radius, 0.005, height, rng.uniform(0.0025, 0.004), segments=5))


def _box(rng: np.random.Generator) -> Solid:
    half = np.array([rng.uniform(0.015, 0.033), rng.uniform(0.015, 0.045), rng.uniform(0.03, 0.07)])
    box = lathe.box(half)
    return Solid(box, (box,), PACKAGE_DENSITY)


def _can(rng: np.random.Generator) -> Solid:
    radius, height = rng.uniform(0.025, 0.034), rng.uniform(0.06, 0.13)
    bevel = rng.uniform(0.001, 0.003)
    profile = np.array(
        [
            (0, 0),
            (radius - bevel, 0),
            (radius, bevel),
            (radius, height - bevel),
            (radius - bevel, height),
            (0, height),
        ]
    )
    whole = lathe.revolved(profile)
    return Solid(whole, (lathe.revolved(profile, 24),), PACKAGE_DENSITY)


FAMILIES: dict[str, Callable[[np.random.Generator], Solid]] = {
    "tumbler": _tumbler,
    "bottle": _bottle,
    "stemmed": _stemmed,
    "bowl": _bowl,
    "jar": _jar,
    "box": _box,
    "can": _can,
}
_FAMILY_NAMES = tuple(FAMILIES)
