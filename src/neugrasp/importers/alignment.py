"""Where a reconstruction lies in the world and how large it is: given in a file, or found from a board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from neugrasp.data.camera_checks import numbers
from neugrasp.data.known_keys import refuse_bends, refuse_unknown
from neugrasp.data.strict_json import read_object
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.importers.files import pose_of

KEYS = ("metres_per_unit", "world_from_reconstruction", "world_from_workspace")
LARGEST_RESIDUAL = 0.01
"""Metres between the cameras of the reconstruction and those that see the board."""
LARGEST_TURN = 2.0
"""Degrees between them."""
SHORTEST_BASELINE = 0.03
"""Metres: root mean square distance of the cameras from their middle, below which no scale can be told."""


@dataclass(frozen=True)
class Alignment:
    """world = world_from_reconstruction applied to metres_per_unit * reconstruction."""

    metres_per_unit: float
    world_from_reconstruction: Array
    """4x4, metres."""
    residual: float = 0.0
    """Root mean square distance between the cameras of both, metres; 0 where it was given."""
    says_scale: bool = True
    """Whether a file gave the scale, rather than leaving it at 1."""
    says_place: bool = True
    """Whether a file gave the place, rather than leaving it."""


def read_alignment(file: Path) -> tuple[Alignment, Workspace]:
    """The alignment and the cube of a file. Raises `InputError` naming file and field.

    {"metres_per_unit": 0.25, "world_from_reconstruction": POSE, "world_from_workspace": POSE}; the first two
    may be absent where the poses are metric and in the world already.
    """
    data = read_object(file, "an alignment")
    refuse_bends(data, KEYS, str(file), "say it as metres_per_unit and world_from_reconstruction")
    refuse_unknown(data, KEYS, str(file))
    metres = float(numbers(data.get("metres_per_unit", 1.0), (), f"{file}: metres_per_unit"))
    if metres <= 0:
        raise InputError(f"{file}: metres_per_unit is {metres:g}; it must be positive")
    world = data.get("world_from_reconstruction")
    pose = np.eye(4) if world is None else pose_of(world, f"{file}: world_from_reconstruction")
    cube = pose_of(data.get("world_from_workspace"), f"{file}: world_from_workspace")
    alignment = Alignment(metres, pose, 0.0, "metres_per_unit" in data, world is not None)
    return alignment, Workspace(world_from_workspace=cube)


def align(
    reconstruction_from_camera: Sequence[Array], world_from_camera: Sequence[Array], has_unit: bool = False
) -> Alignment:
    """The alignment of the same cameras in two frames, the second metric; with `has_unit` the scale is 1.

    Raises `InputError` where there are too few cameras, or where the two do not fit together.
    """
    fewest = 1 if has_unit else 2
    if len(world_from_camera) < fewest:
        raise InputError(
            f"the board is seen in {len(world_from_camera)} of the photos; at least {fewest} must show it"
        )
    ours, theirs = np.stack(world_from_camera), np.stack(reconstruction_from_camera)
    rotation = _mean_rotation(ours[:, :3, :3] @ theirs[:, :3, :3].transpose(0, 2, 1))
    world, units = ours[:, :3, 3], theirs[:, :3, 3] @ rotation.T
    world_spread, units_spread = world - world.mean(axis=0), units - units.mean(axis=0)
    scale = 1.0
    if not has_unit:
        energy = float((units_spread**2).sum())
        if np.sqrt((world_spread**2).sum(axis=1).mean()) < SHORTEST_BASELINE or energy == 0:
            raise InputError("the photos that show the board were taken from one place; no scale can be told")
        scale = float((world_spread * units_spread).sum()) / energy
    shift = world.mean(axis=0) - scale * units.mean(axis=0)
    residual = float(np.sqrt(((scale * units + shift - world) ** 2).sum(axis=1).mean()))
    turned = ours[:, :3, :3].transpose(0, 2, 1) @ rotation @ theirs[:, :3, :3]
    angle = float(np.rad2deg(np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1) / 2, -1, 1)).max()))
    if scale <= 0 or residual > LARGEST_RESIDUAL or angle > LARGEST_TURN:
        raise InputError(
            f"the board and the given poses do not fit together: {residual * 1000:.0f} mm and {angle:.1f} "
            "degrees apart; was the board moved between the photos, or is its size not that of the print?"
        )
    return Alignment(scale, rigid(rotation, shift), residual)


def _mean_rotation(rotations: Array) -> Array:
    """The rotation nearest to the mean of (n, 3, 3)."""
    u, _, v = np.linalg.svd(rotations.mean(axis=0))
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v)
