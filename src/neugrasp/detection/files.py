"""The files of a detection: grasps.json, surface.ply and tsdf.npz, written and read."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from neugrasp.data.fields import Fields
from neugrasp.data.known_keys import refuse_bends
from neugrasp.data.strict_json import read_json
from neugrasp.geometry.pose import Array, from_quaternion, to_quaternion
from neugrasp.geometry.surface import Surface
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp

FORMAT = "neugrasp-grasps"
VERSION = 1
FILES = ("grasps.json", "surface.ply", "tsdf.npz", "overlay.png", "report.html", "surface.png", "slice.png")
"""All that `predict` and `demo` write into a folder; what one of them does not write is an earlier run's."""
KEYS = ("format", "version", "frame", "up", "grasps", "scene", "gripper")
GRASP_KEYS = ("position", "quaternion_xyzw", "width", "score", "pregrasp_position", "retreat_position")
FARTHEST = 1e9
"""Metres from the world's origin within which a grasp may lie."""
NEAR = 10.0
"""The same where nothing else tells the unit."""
LONGEST_APPROACH, STRAIGHT = 0.5, 5.0
"""Metres from the open hand to the grasp, and degrees that it may be off the approach."""
WIDEST = 1.0
"""Metres between the pads."""
HIGHEST = 1.001
"""A score is a probability, but for rounding."""


def document(grasps: Iterable[Grasp], facts: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """The content of a `grasps.json`: grasps in the world frame, best first, and what else is known."""
    ordered = sorted(grasps, key=lambda grasp: -grasp.score)
    entries = [
        {
            "position": grasp.position.tolist(),
            "quaternion_xyzw": to_quaternion(grasp.pose).tolist(),
            "width": float(grasp.width),
            "score": float(grasp.score),
            "pregrasp_position": grasp.pregrasp[:3, 3].tolist(),
            "retreat_position": grasp.retreat[:3, 3].tolist(),
        }
        for grasp in ordered
    ]
    head: dict[str, Any] = {"format": FORMAT, "version": VERSION, "frame": "world"}
    if ordered:
        head["up"] = list(ordered[0].up)
    return {**head, "grasps": entries, **(facts or {})}


def write_grasps(file: Path, grasps: Iterable[Grasp], facts: Mapping[str, Any] | None = None) -> None:
    """A `grasps.json`, as `document` makes it."""
    write_json(file, document(grasps, facts))


def write_json(file: Path, content: Mapping[str, Any]) -> None:
    """Plain data as a file of JSON. Raises `ValueError` on what JSON has no number for."""
    file.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")


@dataclass(frozen=True)
class GraspList:
    """What a `grasps.json` says."""

    grasps: tuple[Grasp, ...]
    """World frame, in the file's order."""
    scene: str | None
    """The folder of the photos."""
    gripper: str | None
    """The name of the gripper that they were found for."""
    knows_up: bool = True
    """Whether it says which way is up; where it does not, the grasps take z."""


def read_grasp_list(file: Path) -> GraspList:
    """The content of a `grasps.json`. Raises `InputError` naming the file and the field."""
    fields = Fields(str(file), read_json(file, "a list of grasps"))
    grasps = grasps_of(fields)
    scene, gripper = (fields.text(key) if key in fields.data else None for key in ("scene", "gripper"))
    return GraspList(grasps, scene, gripper, knows_up="up" in fields.data)


def grasps_of(fields: Fields) -> tuple[Grasp, ...]:
    """The grasps of a `document`. Raises `InputError` naming the source and the field."""
    fields.expect(FORMAT, VERSION)
    refuse_bends(fields.data, KEYS, fields.source)
    if "frame" in fields.data:
        fields.text("frame", ("world",))
    x, y, z = fields.unit("up", 3).tolist() if "up" in fields.data else (0.0, 0.0, 1.0)
    return tuple(replace(_grasp(entry), up=(x, y, z)) for entry in fields.each("grasps"))


def read_grasps(file: Path) -> list[Grasp]:
    """The grasps of a `grasps.json`, world frame. Raises `InputError` naming the file."""
    return list(read_grasp_list(file).grasps)


def _grasp(fields: Fields) -> Grasp:
    refuse_bends(fields.data, GRASP_KEYS, f"{fields.source}: {fields.prefix.rstrip('.')}")
    position = fields.numbers("position", 3, FARTHEST, "[x, y, z] in metres")
    pose = from_quaternion(fields.unit("quaternion_xyzw", 4), position)
    if "pregrasp_position" in fields.data:
        _check_pregrasp(fields, pose)
    elif (far := float(np.linalg.norm(position))) > NEAR:
        raise fields.refuse(
            "position",
            f"is {far:.4g} m from the world's origin, which looks like millimetres; give metres (where the "
            "origin is as far away, give pregrasp_position, too)",
        )
    return Grasp(pose, width_of(fields), fields.number("score", 0, HIGHEST))


def _check_pregrasp(fields: Fields, pose: Array) -> None:
    """Raises `InputError` where the open hand would not come from behind: one of the two was written in
    another unit or another convention."""
    before = fields.numbers("pregrasp_position", 3, FARTHEST, "[x, y, z] in metres")
    back = pose[:3, 3] - before
    distance = float(np.linalg.norm(back))
    if not 0 < distance <= LONGEST_APPROACH:
        raise fields.refuse(
            "pregrasp_position", f"is {distance:.4g} m from position; it must be up to {LONGEST_APPROACH:g} m"
        )
    angle = float(np.rad2deg(np.arccos(np.clip(pose[:3, 2] @ back / distance, -1, 1))))
    if angle > STRAIGHT:
        raise fields.refuse(
            "pregrasp_position",
            f"is {angle:.0f} degrees off the approach, the z axis of quaternion_xyzw; is that in another "
            "order, or one of them in another frame?",
        )


def width_of(fields: Fields) -> float:
    """The width of a grasp, metres, greater than 0. Raises `InputError`."""
    width = fields.number("width", 0, WIDEST, "m")
    if width == 0:
        raise fields.refuse("width", "is 0; the pads must touch something that lies between them")
    return width


def write_surface(file: Path, surface: Surface) -> None:
    """A binary little-endian PLY file, metres; doubles, for worlds whose origin is far away."""
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment neugrasp surface, metres, world frame\n"
        f"element vertex {len(surface.vertices)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(surface.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(surface.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, surface.faces
    with file.open("wb") as stream:
        stream.write(header.encode("ascii"))
        stream.write(surface.vertices.astype("<f8").tobytes())
        stream.write(faces.tobytes())


def write_tsdf(file: Path, tsdf: ArrayLike, workspace: Workspace) -> None:
    """The grid [x, y, z] with what places it: voxel (i, j, k) has its centre at (i + 0.5) voxel sizes."""
    np.savez_compressed(
        file,
        tsdf=np.asarray(tsdf, dtype=np.float32),
        size=workspace.size,
        truncation=workspace.truncation,
        world_from_workspace=workspace.world_from_workspace,
    )
