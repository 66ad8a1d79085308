"""What every detector returns: parallel-jaw grasps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
    """Predicted quality, 0 to 1: higher is better. It is no calibrated probability of success."""
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


@dataclass(frozen=True, eq=False, repr=False)
class Grasps(Sequence[Grasp]):
    """k grasps as arrays; they iterate as `Grasp`. Raises `ValueError` where the arrays do not fit together,
    or a pose is not finite."""

    poses: Array
    """(k, 4, 4), each as `Grasp.pose`."""
    widths: Array
    """(k,), metres."""
    scores: Array
    """(k,), 0 to 1."""
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Unit vector away from the table, in the frame of the poses."""

    def __post_init__(self) -> None:
        k = len(self.poses)
        shapes = self.poses.shape, self.widths.shape, self.scores.shape
        if shapes != ((k, 4, 4), (k,), (k,)):
            raise ValueError(f"grasps of shapes {shapes}; they are (k, 4, 4), (k,) and (k,)")
        if not all(np.all(np.isfinite(array)) for array in (self.poses, self.widths, self.scores)):
            raise ValueError("a grasp's pose, width or score is NaN or infinite")

    @classmethod
    def of(cls, grasps: Iterable[Grasp]) -> Grasps:
        """The same grasps, in their order."""
        each = list(grasps)
        poses = np.array([grasp.pose for grasp in each], dtype=np.float64).reshape(-1, 4, 4)
        widths, scores = (
            np.array([getattr(grasp, name) for grasp in each], dtype=np.float64)
            for name in ("width", "score")
        )
        return cls(poses, widths, scores, each[0].up if each else cls.up)

    @property
    def positions(self) -> Array:
        """(k, 3) the TCPs, metres."""
        return self.poses[:, :3, 3]

    def __len__(self) -> int:
        return len(self.poses)

    @overload
    def __getitem__(self, which: int) -> Grasp: ...

    @overload
    def __getitem__(self, which: slice | NDArray[np.generic]) -> Grasps: ...

    def __getitem__(self, which: int | slice | NDArray[np.generic]) -> Grasp | Grasps:
        """One grasp, or those of a slice, a mask or indices."""
        if isinstance(which, slice | np.ndarray):
            return Grasps(self.poses[which], self.widths[which], self.scores[which], self.up)
        return Grasp(self.poses[which], float(self.widths[which]), float(self.scores[which]), self.up)

    def __eq__(self, other: object) -> bool:
        """Whether the other holds the same numbers."""
        names = ("poses", "widths", "scores")
        return isinstance(other, Grasps) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in names
        )

    def __repr__(self) -> str:
        best = f", the best with score {self.scores.max():.2f}" if len(self) else ""
        return f"<{len(self)} grasp{'s' * (len(self) != 1)}{best}>"
