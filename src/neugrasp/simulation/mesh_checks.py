"""Whether meshes of a user can be a body: closed, right side out, of a size that a gripper meets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array
from neugrasp.simulation.meshes import Mesh, merged

SIZES = (0.002, 1.0)
"""Metres that the longest edge of an object's bounding box may have."""
USUAL = (0.02, 0.5)
"""Metres that it usually has: what a guess at the unit must lead to."""
UNITS = {"millimetres": 0.001, "centimetres": 0.01}
FLAT = 1e-4
"""Metres: the least thickness of an object."""
LEAST_FILL = 1e-4
"""Share of its bounding box that the least solid object fills."""
MOST_TURNED = 0.1
"""Share of the edges at which two faces may disagree which side is out."""


def check_solid(parts: tuple[Mesh, ...], file: Path) -> None:
    """Raises `InputError` naming `file` where a visual mesh bounds no solid of a sensible size."""
    mesh = merged(parts)
    _check_size(mesh, file)
    if not mesh.is_closed():
        raise InputError(f"{file}: the surface is not closed; a body needs a mesh without holes")
    volume, _ = mesh.volume_and_centroid()
    box = float(np.prod(mesh.extents))
    if volume < -LEAST_FILL * box:
        raise InputError(f"{file}: the surface is inside out; turn all faces (anticlockwise from outside)")
    if volume < LEAST_FILL * box:
        raise InputError(f"{file}: the surface encloses no volume; a body needs a solid mesh")
    if mesh.turned_share() > MOST_TURNED:
        raise InputError(f"{file}: some faces are inside out; make all of them anticlockwise from outside")


def check_pair(seen: tuple[Mesh, ...], touched: tuple[Mesh, ...], urdf: Path) -> None:
    """Raises `InputError` where what is touched has no volume, or does not stand where what is seen does."""
    _check_size(merged(touched), urdf)
    for part in touched:
        try:
            ConvexHull(part.vertices)
        except (QhullError, ValueError):
            raise InputError(f"{urdf}: a part of a collision mesh is flat; it must have a volume") from None
    (low, high), (touch_low, touch_high) = (_box(merged(parts)) for parts in (seen, touched))
    if np.any(touch_low > high) or np.any(touch_high < low):
        raise InputError(
            f"{urdf}: the collision mesh (x, y, z from {_words(touch_low)} to {_words(touch_high)} m) stands "
            f"beside the visual mesh ({_words(low)} to {_words(high)}); compare their <origin> and scale"
        )


def beside(parts: tuple[Mesh, ...], centre: Array) -> str:
    """How a centre of mass (3,) lies outside of the bounding box of a body, in words; nothing where it lies
    inside, give or take a tenth."""
    low, high = _box(merged(parts))
    margin = 0.1 * (high - low)
    if np.all(centre >= low - margin) and np.all(centre <= high + margin):
        return ""
    return (
        f"the centre of mass {_words(centre)} lies outside of the object ({_words(low)} to {_words(high)} m)"
    )


def _check_size(mesh: Mesh, file: Path) -> None:
    longest, thinnest = float(mesh.extents.max()), float(mesh.extents.min())
    if not SIZES[0] <= longest <= SIZES[1]:
        size = " x ".join(f"{edge:.3g}" for edge in mesh.extents)
        raise InputError(
            f"{file}: {size} m in size{_unit_of(longest)}; the longest edge must be from {SIZES[0]:g} to "
            f"{SIZES[1]:g} m. Save the mesh in metres, or scale it in the URDF"
        )
    if thinnest < FLAT:
        raise InputError(f"{file}: the mesh is flat ({thinnest:.2g} m thick); a body must have a volume")
    if float(np.abs(mesh.vertices).max()) > 2 * SIZES[1]:
        raise InputError(f"{file}: the mesh lies {np.abs(mesh.vertices).max():.3g} m from its link's origin")


def _unit_of(longest: float) -> str:
    """A guess at what went wrong with the unit."""
    for unit, metres in UNITS.items():
        if longest > SIZES[1] and USUAL[0] <= longest * metres <= USUAL[1]:
            return f" (that looks like {unit})"
        if longest < SIZES[0] and USUAL[0] <= longest / metres <= USUAL[1]:
            return f" (that looks like metres, scaled as if they were {unit})"
    return ""


def _box(mesh: Mesh) -> tuple[Array, Array]:
    return mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)


def _words(vector: Array) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in vector) + ")"
