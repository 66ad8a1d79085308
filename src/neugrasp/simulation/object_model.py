"""What is known of an object: its meshes, its mass and how it touches."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from neugrasp.geometry.pose import Array

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class EngineShape:
    """A collision mesh as the physics engine's loader is told of it: it then computes the same inertia as
    from the user's URDF, while a mesh that was moved before gets another one."""

    mesh: Path
    scale: Triple = (1.0, 1.0, 1.0)
    xyz: Triple = (0.0, 0.0, 0.0)
    rpy: Triple = (0.0, 0.0, 0.0)
    """Turn of the scaled mesh in the frame of the body: metres, and radians about fixed axes."""


@dataclass(frozen=True)
class ObjectModel:
    """One object at scale 1, in metres. The frame of its meshes is the frame of its body."""

    name: str
    visual_mesh: Path
    """Closed surface, OBJ."""
    collision_meshes: tuple[Path, ...]
    """OBJ files; every "o" group of a file stands for its convex hull."""
    mass: float
    """Kilograms at scale 1."""
    lateral_friction: float = 1.0
    centre_of_mass: Triple = (0.0, 0.0, 0.0)
    """In the mesh frame, metres."""
    inertial_rpy: Triple = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw of the frame, about the axes of the mesh frame, in which the engine computes the
    inertia from the shape, radians."""
    engine_shapes: tuple[EngineShape, ...] = ()
    """The collision meshes for the engine's loader; none where they are `collision_meshes` as they are."""


def cache_folder() -> Path:
    """Where meshes made by the project are kept: $NEUGRASP_CACHE, else the user's cache folder."""
    if chosen := os.environ.get("NEUGRASP_CACHE"):
        return Path(chosen) / "objects"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "neugrasp" / "objects"


def triple(vector: Array) -> Triple:
    """A vector of three as plain numbers."""
    x, y, z = vector.tolist()
    return x, y, z
