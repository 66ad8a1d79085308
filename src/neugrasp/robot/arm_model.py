"""Arms with six joints as plain data, and where their links are: forward kinematics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array

JOINTS = 6


@dataclass(frozen=True)
class Capsule:
    """All points within a radius of a segment."""

    frame: int
    """0 is the base; i the frame after joint i, as Denavit and Hartenberg place it."""
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    """End of the segment, metres, in that frame."""
    radius: float


@dataclass(frozen=True)
class ArmModel:
    """A UR arm by its Denavit-Hartenberg parameters (the published ones; a real arm differs by a millimetre
    or two, see docs/robot.md). The base frame is the controller's, the last one is the flange."""

    name: str
    d: tuple[float, ...]
    """(6,) metres."""
    a: tuple[float, ...]
    """(6,) metres."""
    alpha: tuple[float, ...]
    """(6,) radians."""
    low: tuple[float, ...]
    high: tuple[float, ...]
    """(6,) range of the joints, radians."""
    speed: tuple[float, ...]
    """(6,) the most that the arm can, rad/s."""
    capsules: tuple[Capsule, ...]
    """What encloses the links."""

    def frames(self, joints: ArrayLike) -> Array:
        """`base_from_link` (..., 7, 4, 4) of the base and after each joint, of joints (..., 6), radians."""
        q = np.asarray(joints, dtype=np.float64)
        a, d, alpha = (np.array(numbers) for numbers in (self.a, self.d, self.alpha))
        c, s, ca, sa = np.cos(q), np.sin(q), np.cos(alpha), np.sin(alpha)
        steps = np.zeros((*q.shape, 4, 4))
        steps[..., 0, 0], steps[..., 0, 1], steps[..., 0, 2], steps[..., 0, 3] = c, -s * ca, s * sa, a * c
        steps[..., 1, 0], steps[..., 1, 1], steps[..., 1, 2], steps[..., 1, 3] = s, c * ca, -c * sa, a * s
        steps[..., 2, 1], steps[..., 2, 2], steps[..., 2, 3] = sa, ca, d
        steps[..., 3, 3] = 1
        frames = np.empty((*q.shape[:-1], JOINTS + 1, 4, 4))
        frames[..., 0, :, :] = np.eye(4)
        for joint in range(JOINTS):
            frames[..., joint + 1, :, :] = frames[..., joint, :, :] @ steps[..., joint, :, :]
        return frames

    def flange(self, joints: ArrayLike) -> Array:
        """`base_from_flange` (..., 4, 4) of joints (..., 6), radians."""
        return self.frames(joints)[..., -1, :, :]


_PI, _HALF = np.pi, np.pi / 2
_TURN = 2 * np.pi
_RANGE = (_TURN, _TURN, _PI, _TURN, _TURN, _TURN)
"""The elbow cannot turn past the upper arm, whatever the controller allows."""


def _ur(name: str, d: tuple[float, ...], a: tuple[float, float], shoulder: float, elbow: float) -> ArmModel:
    """An arm of the size of a UR5e; `shoulder` and `elbow` are how far to the side upper arm and forearm
    lie, metres. The capsules enclose the meshes of the UR5e (tests/robot/test_arm_model.py)."""
    upper, fore = -a[0], -a[1]
    capsules = (
        Capsule(0, (0, 0, 0.012), (0, 0, 0.049), 0.077),
        Capsule(1, (0, -0.003, 0.001), (0, -0.003, 0.014), 0.085),
        Capsule(2, (upper - 0.018, 0, shoulder), (upper, 0, shoulder), 0.087),
        Capsule(2, (0.099, 0, shoulder), (upper - 0.098, 0, shoulder), 0.048),
        Capsule(2, (0.002, 0, shoulder - 0.009), (0.02, 0, shoulder - 0.009), 0.092),
        Capsule(3, (fore - 0.066, 0, elbow + 0.019), (fore, 0, elbow + 0.019), 0.07),
        Capsule(3, (0.048, 0, elbow - 0.003), (fore - 0.1, 0, elbow - 0.003), 0.042),
        Capsule(3, (0, 0, elbow - 0.012), (0, 0, elbow + 0.014), 0.056),
        Capsule(4, (0, -0.018, -0.001), (0, -0.002, -0.001), 0.068),
        Capsule(5, (0, 0.012, -0.026), (0, 0.012, 0.036), 0.053),
        Capsule(6, (0, -0.001, -0.027), (0, -0.001, -0.026), 0.044),
    )
    high = _RANGE
    low = tuple(-x for x in high)
    lengths = (0.0, *a, 0.0, 0.0, 0.0)
    return ArmModel(name, d, lengths, (_HALF, 0, 0, _HALF, -_HALF, 0), low, high, (_PI,) * JOINTS, capsules)


ARMS = {
    "ur5e": _ur("ur5e", (0.1625, 0, 0, 0.1333, 0.0997, 0.0996), (-0.425, -0.3922), 0.138, 0.007),
    "ur5": _ur("ur5", (0.089159, 0, 0, 0.10915, 0.09465, 0.0823), (-0.425, -0.39225), 0.13585, 0.01615),
}


def arm_model(name: str) -> ArmModel:
    """A known arm. Raises `InputError` on an unknown name."""
    if name not in ARMS:
        raise InputError(f"unknown arm {name!r}; choose one of {', '.join(ARMS)}")
    return ARMS[name]
