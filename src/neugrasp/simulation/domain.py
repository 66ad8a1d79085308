"""How the world in which a detector works differs from the one in which it learned, as plain data.

Every part is left out (None) where it is as in training.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from neugrasp.data.world import Cell
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, rigid
from neugrasp.geometry.workspace import Workspace

SEEN_AROUND = 24
"""Pixels around the workspace that are rendered: as far as errors of pose and lens can move it, and a few."""


@dataclass(frozen=True)
class Room:
    """One room for all scenes, as the fields of a `Cell`."""

    light: Mapping[str, Any]
    table: Mapping[str, Any]
    seed: int
    """Seed of the renderer's noise."""


@dataclass(frozen=True)
class Earlier:
    """The light when the empty table was photographed, against that of the scenes."""

    turn: float
    """Radians by which the panorama stood elsewhere."""
    panorama: float
    """Factor of its strength."""
    lamps: float
    """Factor of the lamps' irradiance."""


@dataclass(frozen=True)
class DomainLens:
    """The pinhole that the reader believes in, and what the glass does besides."""

    focal: tuple[float, float]
    """Pixels, along x and y."""
    principal_point: tuple[float, float]
    size: tuple[int, int]
    """Width and height, pixels."""
    radial: tuple[float, float]
    """k1 and k2 of Brown's model, in units of the focal length."""
    tangential: tuple[float, float]
    """p1 and p2."""

    def seen_by(self, camera: Camera, workspace: Workspace) -> Camera:
        """The same place, seen through this lens; the part of the photo around the workspace."""
        (fx, fy), (cx, cy), (width, height) = self.focal, self.principal_point, self.size
        intrinsics = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        whole = Camera(intrinsics, camera.world_from_camera, width, height)
        left, top, right, bottom = workspace.photo_box(whole)
        around = (left - SEEN_AROUND, top - SEEN_AROUND, right + SEEN_AROUND, bottom + SEEN_AROUND)
        return replace(whole, sensed=replace(whole, sensed=around).bounds)


@dataclass(frozen=True)
class Sensor:
    """What a small camera does to light."""

    vignetting: float
    """Share of the light that is lost in the corners."""
    shot: float
    """Variance of the noise in a white pixel, of light that is 1 there."""
    read: float
    """Standard deviation of the noise in the dark."""
    jpeg: int
    """Quality, 1 to 95."""


@dataclass(frozen=True)
class HandEye:
    """By how much the poses that the reader is told are wrong."""

    millimetres: float
    degrees: float
    """The same for all views: what a calibration leaves."""
    view_millimetres: float
    view_degrees: float
    """Besides, for each view another: what an arm does."""
    seed: int

    def believed_from_true(self, view: int) -> Array:
        """The transform (4, 4) between the camera that the reader believes in and the one that there is."""
        fixed = _error(self.millimetres, self.degrees, np.random.default_rng(self.seed))
        rng = np.random.default_rng([self.seed, view])
        own: Array = fixed @ _error(self.view_millimetres, self.view_degrees, rng)
        return own


@dataclass(frozen=True)
class Domain:
    """A named, fixed set of differences."""

    name: str
    room: Room | None = None
    earlier: Earlier | None = None
    lens: DomainLens | None = None
    sensor: Sensor | None = None
    tone: str | None = None
    """The renderer's view transform, in place of plain sRGB."""
    hand_eye: HandEye | None = None
    friction: float | None = None
    """Friction of all objects."""
    gripper: str | None = None

    def cell(self, drawn: Cell, sensors: tuple[Camera, ...], workspace: Workspace) -> Cell:
        """A cell as it is in this domain; `sensors` are its input cameras before they were cropped."""
        if self.room is not None:
            room = self.room
            drawn = replace(drawn, light=dict(room.light), table=dict(room.table), seed=room.seed)
        if self.lens is not None:
            drawn = replace(drawn, cameras=tuple(self.lens.seen_by(one, workspace) for one in sensors))
        return drawn

    def facts(self) -> dict[str, str]:
        """What a run depends on; nothing where all is as in training."""
        if self == Domain(self.name):
            return {}
        content = json.dumps(asdict(self), sort_keys=True)
        return {"domain": self.name, "domain_sha256": hashlib.sha256(content.encode()).hexdigest()}

    def only(self, parts: list[str]) -> Domain:
        """The same without the other parts. Raises `InputError` where there is no such part."""
        known = [field.name for field in fields(self) if field.name != "name"]
        if unknown := set(parts) - set(known):
            raise InputError(
                f"domain {self.name} has no part {sorted(unknown)[0]!r}; choose from {', '.join(known)}"
            )
        name = f"{self.name}:{'+'.join(part for part in known if part in parts)}"
        return replace(self, name=name, **{part: None for part in known if part not in parts})


def _error(millimetres: float, degrees: float, rng: np.random.Generator) -> Array:
    """A transform (4, 4) as large as that, about and along directions drawn by chance."""
    axis, direction = (vector / np.linalg.norm(vector) for vector in rng.normal(size=(2, 3)))
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * axis).as_matrix()
    return rigid(turn, millimetres / 1000 * direction)
