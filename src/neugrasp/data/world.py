"""A simulated scene as plain data: what physics settles, what Blender renders, what is saved to JSON.

All poses are in the workspace frame (origin at the cube's lower corner, z up, table at z = 0.05 m).
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.fields import Fields
from neugrasp.data.strict_json import parse_json
from neugrasp.geometry.camera import Camera


@dataclass(frozen=True)
class Body:
    """One object lying in the workspace."""

    object_set: str
    """Name of the set it comes from: "pybullet", "glassware" or "folder"."""
    name: str
    """Name of the object in that set."""
    scale: float
    position: tuple[float, float, float]
    """Origin of the object's mesh frame (not its centre of mass), metres."""
    quaternion_xyzw: tuple[float, float, float, float]


@dataclass(frozen=True)
class Material:
    """How an object looks. `parameters` are the renderer's, already jittered."""

    kind: str
    """"diffuse", "specular" or "transparent"."""
    preset: str
    parameters: dict[str, Any]


@dataclass(frozen=True)
class Cell:
    """A work cell: cameras, light and table. Its backgrounds are rendered once for all its scenes."""

    seed: int
    cameras: tuple[Camera, ...]
    """Cropped cameras as rendered, workspace frame: the input views first, then the target views."""
    num_inputs: int
    light: dict[str, Any]
    table: dict[str, Any]


@dataclass(frozen=True)
class Scene:
    """A settled arrangement of bodies. `materials` has one entry per body."""

    kind: str
    """"single", "pile" or "packed"."""
    seed: int
    bodies: tuple[Body, ...]
    materials: tuple[Material, ...] = field(default=())


def scene_to_json(scene: Scene) -> str:
    """The scene as JSON text; floats keep all their digits."""
    return json.dumps({"format": "neugrasp-world", "version": 1, **asdict(scene)}, indent=1)


def scene_from_json(text: str, source: str | Path = "world.json") -> Scene:
    """The inverse of `scene_to_json`. Raises `InputError` naming `source`."""
    fields = Fields(f"{source}", parse_json(text, f"{source}"))
    fields.expect("neugrasp-world", 1)
    bodies, materials = map(_body, fields.each("bodies")), map(_material, fields.each("materials"))
    return Scene(fields.text("kind"), fields.whole("seed", 0, 2**64), tuple(bodies), tuple(materials))


def _body(fields: Fields) -> Body:
    x, y, z = fields.numbers("position", 3, 10.0, "[x, y, z] in metres").tolist()
    qx, qy, qz, qw = fields.numbers("quaternion_xyzw", 4, 1.001, "[x, y, z, w]").tolist()
    scale = fields.number("scale", 1e-9, 1e3)
    return Body(fields.text("object_set"), fields.text("name"), scale, (x, y, z), (qx, qy, qz, qw))


def _material(fields: Fields) -> Material:
    return Material(fields.text("kind"), fields.text("preset"), fields.inside("parameters").data)


def camera_to_dict(camera: Camera) -> dict[str, Any]:
    """A camera as JSON-ready data."""
    return {
        "intrinsics": camera.intrinsics.tolist(),
        "world_from_camera": camera.world_from_camera.tolist(),
        "width": camera.width,
        "height": camera.height,
        "sensed": None if camera.sensed is None else [float(x) for x in camera.sensed],
    }


def camera_from_dict(data: dict[str, Any]) -> Camera:
    """The inverse of `camera_to_dict`."""
    return Camera(
        np.array(data["intrinsics"], dtype=np.float64),
        np.array(data["world_from_camera"], dtype=np.float64),
        int(data["width"]),
        int(data["height"]),
        None if data["sensed"] is None else tuple(data["sensed"]),
    )
