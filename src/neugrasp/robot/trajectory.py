"""Motions in time: joint positions at moments, from rest to rest, as fast as the limits let them be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from neugrasp.geometry.pose import Array
from neugrasp.robot.arm_model import JOINTS, ArmModel

PERIOD = 0.008
"""Seconds between two moments: 125 Hz, which every UR controller takes."""
SHORTEST = 0.05
"""Seconds that the shortest motion takes."""
SAFETY = 0.98
"""Share of the limits that is used: differences of samples overshoot a little."""


@dataclass(frozen=True)
class Trajectory:
    """Where the joints are to be, and when. Raises `ValueError` where times and joints do not fit."""

    times: Array
    """(n,) seconds from the start, increasing."""
    joints: Array
    """(n, 6) radians."""

    def __post_init__(self) -> None:
        n = len(self.times)
        if n < 2 or self.joints.shape != (n, JOINTS):
            raise ValueError(f"times {self.times.shape}, joints {self.joints.shape}; (n,) and (n, 6), n >= 2")

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.times[-1] - self.times[0])

    def at(self, seconds: float) -> Array:
        """The joints (6,) at a moment; the ends outside."""
        return np.array([np.interp(seconds, self.times, column) for column in self.joints.T])

    def slowed(self, scale: float) -> Trajectory:
        """The same way at `scale` (0 to 1) of the speed."""
        return Trajectory(self.times / scale, self.joints)

    def back(self, seconds: float) -> Trajectory:
        """The way back from where a motion stood after so many seconds to its start."""
        done = np.append(self.times[self.times < seconds], min(seconds, self.times[-1]))
        joints = np.stack([self.at(moment) for moment in done])
        return Trajectory(done[-1] - done[::-1], joints[::-1]) if len(done) > 1 else still(joints[0])


@dataclass(frozen=True)
class Pace:
    """How fast a motion may be."""

    joint_speed: float
    """rad/s, of every joint."""
    joint_acceleration: float
    """rad/s^2."""
    tcp_speed: float
    """m/s."""

    def scaled(self, scale: float) -> Pace:
        """The same ways in 1 / `scale` of the time."""
        return Pace(scale * self.joint_speed, scale * scale * self.joint_acceleration, scale * self.tcp_speed)


def still(joints: Array) -> Trajectory:
    """No motion."""
    return Trajectory(np.array([0.0, SHORTEST]), np.stack([joints, joints]))


def timed(legs: Sequence[Array], model: ArmModel, flange_from_tcp: Array, pace: Pace) -> Trajectory:
    """The motion along legs (m, 6) that follow one another, at rest where two of them meet.

    Along a leg the way grows as 10 t^3 - 15 t^4 + 6 t^5, the polynomial of least degree that starts and ends
    without speed and acceleration; the time is the least that keeps joints and TCP within their `pace`.
    """
    parts = [_timed(leg, model, flange_from_tcp, pace) for leg in legs]
    times, joints, start = [np.zeros(1)], [parts[0].joints[:1]], 0.0
    for part in parts:
        times.append(start + part.times[1:])
        joints.append(part.joints[1:])
        start += part.duration
    return Trajectory(np.concatenate(times), np.concatenate(joints))


def _timed(leg: Array, model: ArmModel, flange_from_tcp: Array, pace: Pace) -> Trajectory:
    """One leg."""
    length = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(leg, axis=0)).max(axis=1))])
    if length[-1] < 1e-9:
        return still(leg[0])
    way = length / length[-1]
    samples = max(50, 2 * len(leg))
    u = np.linspace(0, 1, samples)
    joints = _along(way, leg, u)
    tcp = (model.flange(joints) @ flange_from_tcp)[:, :3, 3]
    step = u[1] - u[0]
    speed = np.abs(np.diff(joints, axis=0)).max() / step / pace.joint_speed
    speed = max(speed, float(np.linalg.norm(np.diff(tcp, axis=0), axis=1).max()) / step / pace.tcp_speed)
    acceleration = np.abs(np.diff(joints, 2, axis=0)).max() / step**2 / pace.joint_acceleration
    duration = max(SHORTEST, speed / SAFETY, float(np.sqrt(acceleration / SAFETY)))
    count = max(2, int(np.ceil(duration / PERIOD)) + 1)
    times = np.linspace(0, duration, count)
    return Trajectory(times, _along(way, leg, times / duration))


def _along(way: Array, leg: Array, u: Array) -> Array:
    """The joints at shares `u` of the time."""
    s = u**3 * (10 - 15 * u + 6 * u * u)
    return np.stack([np.interp(s, way, column) for column in leg.T], axis=1)
