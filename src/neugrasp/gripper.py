"""The gripper as data, read from one JSON file: the simulator, the labels and the overlays all use it.

The hand frame has its origin at the flange, z towards the finger tips, y along the line on which the fingers
close. Grasps are given at the TCP, a point between the pads.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError

from neugrasp.data.fields import Fields
from neugrasp.data.strict_json import read_json
from neugrasp.errors import GripperFileError, InputError, told_as
from neugrasp.geometry.pose import Array

FORMAT, VERSION = "neugrasp-gripper", 1
LENGTHS = ("max_opening", "finger_depth", "tcp_height", "tcp_depth")
FORCES = ("closing_force", "closing_speed", "holding_force", "centring_force")
LINK_KEYS = ("mass", "centre_of_mass", "parts")
REACH = 1.0
"""Metres from the flange within which every corner of a gripper lies."""
STEM = 0.06
"""Length in metres of the line that stands for the arm in overlays."""


@dataclass(frozen=True)
class Link:
    """A rigid part of the gripper: the palm, or the finger on the side of +y."""

    mass: float
    """Kilograms."""
    centre_of_mass: Array
    """(3,), metres, in the link's frame."""
    hulls: tuple[Array, ...]
    """Corners (n, 3) of the convex parts that can touch something, metres, in the link's frame."""


@dataclass(frozen=True)
class Pads:
    """How the finger pads touch."""

    lateral_friction: float
    spinning_friction: float
    stiffness: float
    """N/m."""
    damping: float
    """N s/m."""


@dataclass(frozen=True)
class FingerArc:
    """The way of fingertips that swing on a four-bar linkage and stay parallel: part of a circle, on which
    they move along the approach as they close."""

    radius: float
    """Radius of the circle, metres."""
    offset: float
    """y of its centre, metres: the pad is there when the finger stands straight ahead."""

    def angle(self, opening: float) -> float:
        """Angle of the crank, radians, with the pads `opening` metres apart; proportional to the motor's
        way."""
        return float(np.arccos(np.clip((opening / 2 - self.offset) / self.radius, -1, 1)))

    def opening(self, angle: float) -> float:
        """The reverse of `angle`."""
        return float(2 * (self.offset + self.radius * np.cos(angle)))


@dataclass(frozen=True)
class Gripper:
    """A parallel-jaw gripper. The second finger is the first one turned by pi about z."""

    name: str
    max_opening: float
    """Largest distance between the pads, metres."""
    finger_depth: float
    """Length of finger, from the tip, that may close around an object, metres."""
    tcp_height: float
    """z of the TCP in the hand frame, metres."""
    tcp_depth: float
    """Distance along the approach from the grasp point, to which labels and voxels refer, to the TCP."""
    palm: Link
    finger: Link
    """In a frame with the hand's axes; y = 0 is the pad's surface."""
    finger_mount: float
    """z of the finger's frame in the hand frame, metres."""
    pads: Pads
    closing_force: float
    """Newton, of each finger."""
    closing_speed: float
    """m/s, of each finger."""
    holding_force: float
    """Newton with which the arm holds the hand on its path."""
    centring_force: float
    """Newton with which the gear keeps both fingers at the same distance from the middle."""
    finger_arc: FingerArc | None = None
    """How the tips move along the approach; None: they do not. Hulls and TCP are those of closed fingers."""

    @classmethod
    @told_as(GripperFileError)
    def load(cls, name_or_path: str | Path) -> Gripper:
        """A bundled gripper by name, or a file. Raises `GripperFileError` naming the file and the field."""
        path = _file_of(name_or_path)
        return _gripper(Fields(str(path), read_json(path, "a gripper")))

    @classmethod
    def from_dict(cls, data: Any, source: str = "a gripper") -> Gripper:
        """What a gripper file says, as plain data. Raises `InputError` naming `source` and the field."""
        return _gripper(data if isinstance(data, Fields) else Fields(source, data))

    def to_dict(self) -> dict[str, Any]:
        """The content of a gripper file that `from_dict` and `load` read as this gripper."""
        plain = asdict(self)
        if self.finger_arc is None:
            del plain["finger_arc"]
        for link in (self.palm, self.finger):
            parts = [{"hull": hull.tolist()} for hull in link.hulls]
            entry = {"mass": link.mass, "centre_of_mass": link.centre_of_mass.tolist(), "parts": parts}
            plain["palm" if link is self.palm else "finger"] = entry
        plain["finger"] |= {"mount": plain.pop("finger_mount"), "pads": plain.pop("pads")}
        return {"format": FORMAT, "version": VERSION, **plain}

    def tip_setback(self, opening: ArrayLike) -> Array:
        """Metres (...) by which pads `opening` (...) metres apart stand farther back than closed ones.

        The TCP is between the pads, so where it has to be the hand goes so much deeper.
        """
        apart = np.asarray(opening, dtype=np.float64)
        if self.finger_arc is None:
            return np.zeros_like(apart)
        radius, offset = self.finger_arc.radius, self.finger_arc.offset
        ahead = np.sqrt(radius**2 - (apart / 2 - offset) ** 2)
        return np.asarray(np.sqrt(radius**2 - offset**2) - ahead)

    def finger_hulls(self, opening: float, setback: float = 0.0) -> tuple[Array, ...]:
        """Corners (n, 3) of the convex parts of both fingers, hand frame, metres: the pads `opening` metres
        apart, and `setback` metres farther back than closed ones."""
        mount = np.array([0.0, opening / 2, self.finger_mount - setback])
        one = [hull + mount for hull in self.finger.hulls]
        return (*one, *(hull * [-1.0, -1.0, 1.0] for hull in one))

    @property
    def tip_height(self) -> float:
        """z of the finger tips in the hand frame, metres."""
        return self.finger_mount + max(float(hull[:, 2].max()) for hull in self.finger.hulls)

    @property
    def palm_height(self) -> float:
        """z of the palm's front in the hand frame, metres."""
        return max(float(hull[:, 2].max()) for hull in self.palm.hulls)

    def wireframe(self, opening: float) -> Array:
        """Segments (4, 2, 3) in the grasp frame, metres: palm, two fingers and the arm behind."""
        half = opening / 2
        palm = self.palm_height - self.tcp_height + float(self.tip_setback(opening))
        tip = self.tip_height - self.tcp_height
        left, right, middle = (0.0, half, palm), (0.0, -half, palm), (0.0, 0.0, palm)
        segments = [
            (left, right),
            (left, (0.0, half, tip)),
            (right, (0.0, -half, tip)),
            ((0.0, 0.0, palm - STEM), middle),
        ]
        return np.array(segments)


def gripper_hash(name_or_path: str | Path) -> str:
    """SHA-256 of what a gripper's file says, whatever its spaces. Raises `InputError` as `Gripper.load`."""
    path = _file_of(name_or_path)
    content = json.dumps(read_json(path, "a gripper"), sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()


def _file_of(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    if path.suffix == ".json":
        return path
    if str(name_or_path) not in bundled():
        raise InputError(
            f"unknown gripper {str(name_or_path)!r}; choose one of {', '.join(bundled())}, "
            "or give the path of a .json file"
        )
    return Path(str(_folder() / f"{name_or_path}.json"))


def bundled() -> tuple[str, ...]:
    """Names of the grippers that come with the package."""
    return tuple(sorted(f.name[:-5] for f in _folder().iterdir() if f.name.endswith(".json")))


def _folder() -> Any:
    return resources.files("neugrasp") / "grippers"


def _gripper(fields: Fields) -> Gripper:
    fields.expect(FORMAT, VERSION)
    fields.only((*LENGTHS, *FORCES, "format", "version", "name", "palm", "finger", "finger_arc"))
    if not fields.text("name"):
        raise fields.refuse("name", "must be a word")
    palm, finger = fields.inside("palm"), fields.inside("finger")
    pads = finger.inside("pads")
    palm.only(LINK_KEYS)
    finger.only((*LINK_KEYS, "mount", "pads"))
    pads.only(Pads.__dataclass_fields__)
    gripper = Gripper(
        name=fields.text("name"),
        max_opening=fields.number("max_opening", 0.005, 0.5, "m"),
        finger_depth=fields.number("finger_depth", 0.005, 0.3, "m"),
        tcp_height=fields.number("tcp_height", 0.01, 0.5, "m"),
        tcp_depth=fields.number("tcp_depth", 0.0, 0.3, "m"),
        palm=_link(palm),
        finger=_link(finger),
        finger_mount=finger.number("mount", 0.0, 0.5, "m"),
        pads=Pads(
            lateral_friction=pads.number("lateral_friction", 0.01, 10),
            spinning_friction=pads.number("spinning_friction", 0, 10),
            stiffness=pads.number("stiffness", 1, 1e7, "N/m"),
            damping=pads.number("damping", 0, 1e6, "N s/m"),
        ),
        closing_force=fields.number("closing_force", 0.1, 1000, "N"),
        closing_speed=fields.number("closing_speed", 0.001, 2, "m/s"),
        holding_force=fields.number("holding_force", 1, 1e5, "N"),
        centring_force=fields.number("centring_force", 0.1, 1e5, "N"),
        finger_arc=_arc(fields.inside("finger_arc")) if "finger_arc" in fields.data else None,
    )
    _check(fields, gripper)
    return gripper


def _link(fields: Fields) -> Link:
    parts = fields.each("parts")
    if not parts:
        raise fields.refuse("parts", "must be a list of at least one box or hull")
    mass = fields.number("mass", 1e-3, 20, "kg")
    return Link(mass, _point(fields, "centre_of_mass"), tuple(map(_hull, parts)))


def _arc(fields: Fields) -> FingerArc:
    fields.only(("radius", "offset"))
    return FingerArc(fields.number("radius", 0.01, 0.5, "m"), fields.number("offset", -0.2, 0.2, "m"))


def _point(fields: Fields, field: str) -> Array:
    return fields.numbers(field, 3, REACH, "[x, y, z] in metres (each within 1 m of the flange)")


def _hull(part: Fields) -> Array:
    part.only(("hull",) if "hull" in part.data else ("size", "centre"))
    if "hull" in part.data:
        shape = "[[x, y, z], ...] in metres (each within 1 m of the flange)"
        corners = part.rows("hull", 3, REACH, shape)
    elif "size" in part.data:
        size, centre = _point(part, "size"), _point(part, "centre")
        if not np.all(size > 0):
            raise part.refuse("size", f"is {size.tolist()}; all three edges must be longer than 0 m")
        corners = centre + size / 2 * np.array(_signs())
    else:
        raise part.refuse("hull", 'is missing; a part is {"hull": [...]} or {"size": ..., "centre": ...}')
    try:
        ConvexHull(corners)
    except (QhullError, ValueError) as error:
        raise part.refuse("hull", "is flat or has fewer than 4 points; it must enclose a volume") from error
    return corners


def _signs() -> Iterable[tuple[int, int, int]]:
    return [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]


def _check(fields: Fields, gripper: Gripper) -> None:
    """What no single field can tell. Raises `InputError`."""
    innermost = min(float(hull[:, 1].min()) for hull in gripper.finger.hulls)
    if not -0.001 <= innermost <= 0.001:
        raise fields.refuse(
            "finger.parts",
            f"come to y = {innermost:g} m; the pad must lie at y = 0, the rest at y > 0 (fingers closed)",
        )
    if not gripper.palm_height < gripper.tcp_height <= gripper.tip_height:
        raise fields.refuse(
            "tcp_height",
            f"is {gripper.tcp_height:g} m; it must lie between the palm's front ({gripper.palm_height:g} m) "
            f"and the finger tips ({gripper.tip_height:g} m)",
        )
    arc = gripper.finger_arc
    if arc is not None and not abs(gripper.max_opening / 2 - arc.offset) < arc.radius > abs(arc.offset):
        raise fields.refuse("finger_arc", "is too small: its fingers reach neither 0 nor max_opening")
    if gripper.tcp_depth > gripper.tcp_height:
        raise fields.refuse("tcp_depth", "is greater than tcp_height; the grasp point is behind the flange")
