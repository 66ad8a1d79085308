"""All positions of the joints that bring the flange of a UR arm to a pose, in closed form.

The wrist's axes 2, 3 and 4 are parallel, so the six angles follow one after the other: the shoulder from
where the wrist is, the second wrist joint from how far the flange stands out of the arm's plane, then a
triangle of upper arm and forearm. Two choices each give up to eight solutions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from neugrasp.geometry.pose import Array, inverse
from neugrasp.robot.arm_model import JOINTS, ArmModel

SINGULAR = 1e-8
"""Sine of the second wrist joint below which the axes 4 and 6 are one: only their sum is determined."""
SLACK = 1e-9
"""By how much a cosine may exceed 1: a pose exactly at the end of the reach."""


def joints_of(model: ArmModel, base_from_flange: ArrayLike, wrist_3: float = 0.0) -> Array:
    """All solutions (n, 6) with n from 0 to 8, radians in (-pi, pi], whatever the range of the joints.

    Where the axes 4 and 6 lie on one line there are infinitely many; the last joint is `wrist_3` then.
    """
    flange = np.asarray(base_from_flange, dtype=np.float64)
    found = [
        (shoulder, *triangle, wrist_2, last)
        for shoulder in _shoulders(model, flange)
        for wrist_2 in _wrists(model, flange, shoulder)
        for last in (_last(flange, shoulder, wrist_2, wrist_3),)
        for triangle in _triangles(model, flange, shoulder, wrist_2, last)
    ]
    joints = np.array(found, dtype=np.float64).reshape(-1, JOINTS)
    return _wrapped(joints)


def in_range(model: ArmModel, joints: Array, near: Array) -> Array:
    """The same solutions (n, 6), each joint turned by whole turns so that it is as near as its range allows
    to `near` (6,); those that no turn brings into the range are left out."""
    turned = near + _wrapped(joints - near)
    low, high = np.array(model.low), np.array(model.high)
    turned = np.where(turned > high, turned - 2 * np.pi, np.where(turned < low, turned + 2 * np.pi, turned))
    return turned[np.all((turned >= low) & (turned <= high), axis=1)]


def _wrapped(angles: Array) -> Array:
    """The same angles in (-pi, pi]."""
    wrapped: Array = np.pi - np.mod(np.pi - angles, 2 * np.pi)
    return wrapped


def _arccos(cosine: float) -> tuple[float, ...]:
    """Both angles of a cosine; one where it is 0 or pi, none where there is none."""
    if not abs(cosine) <= 1 + SLACK:
        return ()
    angle = float(np.arccos(np.clip(cosine, -1, 1)))
    return (angle, -angle)


def _shoulders(model: ArmModel, flange: Array) -> list[float]:
    x, y, _ = flange[:3, 3] - model.d[5] * flange[:3, 2]
    across = float(np.hypot(x, y))
    if across < abs(model.d[3]):
        return []
    towards = float(np.arctan2(y, x))
    return [towards + angle + np.pi / 2 for angle in _arccos(model.d[3] / across)]


def _wrists(model: ArmModel, flange: Array, shoulder: float) -> tuple[float, ...]:
    x, y, _ = flange[:3, 3]
    return _arccos(float(x * np.sin(shoulder) - y * np.cos(shoulder) - model.d[3]) / model.d[5])


def _last(flange: Array, shoulder: float, wrist_2: float, free: float) -> float:
    if abs(np.sin(wrist_2)) < SINGULAR:
        return free
    s, c, sign = np.sin(shoulder), np.cos(shoulder), np.sign(np.sin(wrist_2))
    (xx, yx, _), (xy, yy, _) = flange[0, :3], flange[1, :3]
    return float(np.arctan2(sign * (-yx * s + yy * c), sign * (xx * s - xy * c)))


def _step(model: ArmModel, joint: int, angle: float) -> Array:
    """The transform over one joint."""
    c, s = np.cos(angle), np.sin(angle)
    ca, sa = np.cos(model.alpha[joint]), np.sin(model.alpha[joint])
    a, d = model.a[joint], model.d[joint]
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])


def _triangles(
    model: ArmModel, flange: Array, shoulder: float, wrist_2: float, last: float
) -> list[tuple[float, float, float]]:
    """Shoulder lift, elbow and first wrist joint: a triangle in the arm's plane, bent either way."""
    wrist = inverse(_step(model, 0, shoulder)) @ flange
    wrist = wrist @ inverse(_step(model, 4, wrist_2) @ _step(model, 5, last))
    x, y, _ = wrist[:3, 3]
    upper, fore = model.a[1], model.a[2]
    bends = _arccos(float(x * x + y * y - upper * upper - fore * fore) / (2 * upper * fore))
    found = []
    for elbow in bends:
        lift = float(np.arctan2(y, x) - np.arctan2(fore * np.sin(elbow), upper + fore * np.cos(elbow)))
        # The wrist's own x axis turns by the sum of the three.
        total = float(np.arctan2(wrist[1, 0], wrist[0, 0]))
        found.append((lift, elbow, total - lift - elbow))
    return found
