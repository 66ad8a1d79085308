"""What every detector returns: a parallel-jaw grasp."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from neugrasp.geometry.pose import Array

APPROACH = 0.05
"""Metres from the pre-grasp to the grasp, wherever one is carried out: in labels, rounds and on a robot."""
RETREAT = 0.10
"""Metres from the grasp to where the hand has taken the object."""
SIDE_GRASP = np.pi / 3
"""From this angle between the approach and straight down on, the hand retreats upwards."""


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
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Unit vector away from the table, in the frame of the pose; z in the workspace frame."""

    def __repr__(self) -> str:
        place, approach = (
            ", ".join(f"{x:{form}}" for x in vector)
            for vector, form in ((self.position, "+.3f"), (self.approach, "+.2f"))
        )
        width = f"{1000 * self.width:.0f} mm"
        return f"Grasp(score {self.score:.2f}, width {width}, TCP ({place}) m, approach ({approach}))"

    @property
    def position(self) -> Array:
        """The TCP, metres."""
        return self.pose[:3, 3]

    @property
    def approach(self) -> Array:
        """Unit vector along which the gripper approaches."""
        return self.pose[:3, 2]

    @property
    def pregrasp(self) -> Array:
        """4x4 pose in which the open hand stands before it goes straight to the grasp, 5 cm back."""
        return self.advanced(-APPROACH).pose

    @property
    def retreat(self) -> Array:
        """4x4 pose to which the closed hand goes straight from the grasp: 10 cm up after a grasp from the
        side, else as far back along the approach."""
        if np.arccos(np.clip(-self.approach @ self.up, -1, 1)) <= SIDE_GRASP:
            return self.advanced(-RETREAT).pose
        pose = self.pose.copy()
        pose[:3, 3] = self.position + RETREAT * np.array(self.up)
        return pose

    def moved(self, new_from_old: ArrayLike) -> Grasp:
        """The same grasp seen from another frame."""
        moving = np.asarray(new_from_old, dtype=np.float64)
        x, y, z = (moving[:3, :3] @ self.up).tolist()
        return replace(self, pose=moving @ self.pose, up=(x, y, z))

    def advanced(self, distance: float) -> Grasp:
        """The grasp shifted along its approach by `distance` metres (negative: backed off)."""
        pose = self.pose.copy()
        pose[:3, 3] += distance * pose[:3, 2]
        return replace(self, pose=pose)
