"""A simulated scene as plain data: what physics settles, what Blender renders, what is saved to JSON.

All poses are in the workspace frame (origin at the cube's lower corner, z up, table at z = 0.05 m).
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.errors import InputError
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
    try:
        data = json.loads(text)
        if data["format"] != "neugrasp-world" or data["version"] != 1:
            raise InputError(f"{source}: not a neugrasp-world of version 1")
        bodies = tuple(
            Body(
                b["object_set"],
                b["name"],
                float(b["scale"]),
                tuple(b["position"]),
                tuple(b["quaternion_xyzw"]),
            )
            for b in data["bodies"]
        )
        materials = tuple(Material(m["kind"], m["preset"], m["parameters"]) for m in data["materials"])
        return Scene(data["kind"], int(data["seed"]), bodies, materials)
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise InputError(f"{source}: damaged world description ({error!r})") from error


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
