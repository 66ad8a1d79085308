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
    """Whether grasps go as deep as the surface lets the hand, and are dropped where it would meet it."""
    evaluator: str = "neugrasp"
    """A name of a bundled evaluator of grasps, or a file: what the detectors that have one ask."""
    restorer: str = "swindr"
    """A name of bundled weights that restore depth, or a file: what swindr-vgn asks before VGN."""
    seed: int = 0
    """Of detectors that draw random numbers."""
    device: str = "cpu"
    """Where PyTorch computes."""
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
    """What a grasp must satisfy besides; everything in the world of the scene.

    Raises `InputError` on a region, a cone, a height or a number of grasps that cannot be meant.
    """

    region: Box | None = None
    """Box in which the point between the fingertips must lie: x, y and z from, x, y and z to, metres."""
    mask: tuple[int, Path] | None = None
    """Number of a view and a picture of its photo's size: the point between the fingertips must be seen where
    that is brighter than half."""
    approach: Cone | None = None
    """Direction x, y, z in which the hand may move to the grasp, and by how many degrees it may deviate:
    0 0 -1 30 is from above."""
    min_height: float | None = None
    """Least height of the point between the fingertips above the table, metres."""
    one_object: bool = False
    """Only grasps of one object, that of the best grasp which is left: one object at a time. What touches is
    one object here."""
    top: int | None = None
    """So many grasps at most, the best."""

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
