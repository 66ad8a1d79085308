"""What every detector returns: a parallel-jaw grasp."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from neugrasp.geometry.pose import Array


@dataclass(frozen=True)
class Grasp:
    """A parallel-jaw grasp. Its frame: z approaches, y closes the fingers, the origin is the TCP between
    the pads. A turn by pi about z gives the same grasp."""

    pose: Array
    """4x4 `world_from_grasp` (or `workspace_from_grasp` inside the package), metres."""
    width: float
    """Distance between the pads when they touch the object, metres."""
    score: float = 1.0
    """Predicted probability of success, 0 to 1."""

    @property
    def position(self) -> Array:
        """The TCP, metres."""
        return self.pose[:3, 3]

    @property
    def approach(self) -> Array:
        """Unit vector along which the gripper approaches."""
        return self.pose[:3, 2]

    def moved(self, new_from_old: ArrayLike) -> Grasp:
        """The same grasp seen from another frame."""
        return replace(self, pose=np.asarray(new_from_old, dtype=np.float64) @ self.pose)

    def advanced(self, distance: float) -> Grasp:
        """The grasp shifted along its approach by `distance` metres (negative: backed off)."""
        pose = self.pose.copy()
        pose[:3, 3] += distance * pose[:3, 2]
        return replace(self, pose=pose)
