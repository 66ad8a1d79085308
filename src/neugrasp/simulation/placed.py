"""A body in the physics engine, which places the centre of mass where we place the mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from neugrasp.data.world import Body
from neugrasp.geometry.pose import Array, from_quaternion

Placing = tuple[Array, tuple[float, float, float, float]]
"""Position (3,) of the centre of mass, metres, and quaternion xyzw of the frame of the inertia."""


@dataclass(frozen=True)
class Placed:
    """A body in the engine."""

    uid: int
    body: Body
    """As it was added; its pose is out of date."""
    centre_of_mass: Array
    """(3,), in the mesh frame, scaled, metres."""
    turn: Rotation | None = None
    """`mesh_from_inertia`; None where both have the same axes."""

    def placing(self, body: Body) -> Placing:
        """What the engine is told so that the mesh stands as `body` says."""
        pose = from_quaternion(body.quaternion_xyzw, body.position)
        centre = pose[:3, 3] + pose[:3, :3] @ self.centre_of_mass
        if self.turn is None:
            return centre, body.quaternion_xyzw
        x, y, z, w = (Rotation.from_quat(body.quaternion_xyzw) * self.turn).as_quat().tolist()
        return centre, (x, y, z, w)

    def body_at(
        self, position: tuple[float, float, float], quaternion: tuple[float, float, float, float]
    ) -> Body:
        """The body, standing as the engine says."""
        if self.turn is not None:
            x, y, z, w = (Rotation.from_quat(quaternion) * self.turn.inv()).as_quat().tolist()
            quaternion = (x, y, z, w)
        if self.centre_of_mass.any():
            offset = from_quaternion(quaternion)[:3, :3] @ self.centre_of_mass
            x, y, z = (np.array(position) - offset).tolist()
            position = (x, y, z)
        return replace(self.body, position=position, quaternion_xyzw=quaternion)
