"""What a user may say of any detector, and of the grasps that are wanted, as plain data."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from neugrasp.errors import InputError


@dataclass(frozen=True, kw_only=True)
class DetectorOptions:
    """Each detector takes what it understands of it."""

    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""
    threshold: float | None = None
    """Score from which a grasp is one; None: the detector's own."""
    hand_check: bool = True
    """Push each grasp as deep as the surface allows, and drop grasps that would collide or close on
    nothing."""
    evaluator: str = "neugrasp"
    """The evaluator of grasps, for detectors that ask one: a bundled name, or a file."""
    restorer: str = "swindr"
    """The weights with which swindr-vgn restores depth: a bundled name, or a file."""
    seed: int = 0
    """Random seed of detectors that draw random numbers."""
    device: str = "cpu"
    """Device of PyTorch."""
    precision: str = "float32"
    """float32, or bfloat16 where that is faster."""

    @classmethod
    def of(cls, command: object) -> DetectorOptions:
        """What a command says of them, under the same names."""
        names = [one.name for one in fields(cls) if hasattr(command, one.name)]
        return cls(**{name: getattr(command, name) for name in names})


TALLEST = 2.0
"""Metres above the table in which a least height may lie."""
Box = tuple[float, float, float, float, float, float]
Cone = tuple[float, float, float, float]


LARGEST_REGION = 10.0
"""Metres; a region that is longer, and ends somewhere, was written in another unit."""


@dataclass(frozen=True, kw_only=True)
class Steering:
    """Further conditions on grasps, in the world frame of the scene.

    Raises `InputError` on a region, a cone, a height or a number of grasps that cannot be meant.
    """

    region: Box | None = None
    """Box that must contain the point between the fingertips: lowest x, y, z, then highest x, y, z,
    metres."""
    mask: tuple[int, Path] | None = None
    """Number of a view, and a mask of its photo's size: the point between the fingertips must be seen
    where the mask is brighter than half."""
    approach: Cone | None = None
    """Direction x, y, z in which the hand approaches, and how many degrees it may deviate: 0 0 -1 30 is
    from above."""
    min_height: float | None = None
    """Minimum height of the point between the fingertips above the table, metres."""
    one_object: bool = False
    """Only grasps on the object of the best remaining grasp. Objects that touch count as one."""
    top: int | None = None
    """Maximum number of grasps, the best ones."""

    def __post_init__(self) -> None:
        if self.region is not None and not all(self.region[i] < self.region[i + 3] for i in range(3)):
            raise InputError(f"--region {_words(self.region)}: give the lower corner, then the upper one")
        edges = [] if self.region is None else [self.region[i + 3] - self.region[i] for i in range(3)]
        if any(LARGEST_REGION < edge < np.inf for edge in edges):
            raise InputError(
                f"--region {_words(self.region or ())}: {max(edges):g} m long, which looks like "
                "millimetres; give metres"
            )
        if self.approach is not None:
            *direction, degrees = self.approach
            if not 0 < float(np.linalg.norm(direction)) < np.inf or not 0 < degrees <= 180:
                raise InputError(
                    f"--approach {_words(self.approach)}: a direction that is not 0, then 0 to 180 degrees"
                )
        if self.min_height is not None and not abs(self.min_height) < TALLEST:
            raise InputError(f"--min-height {self.min_height:g}: must be in metres above the table")
        if self.top is not None and self.top < 1:
            raise InputError(f"--top {self.top}: must be at least 1")


def _words(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:g}" for number in numbers)
