"""Motions in time: joint positions at moments, from rest to rest, as fast as the limits let them be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from neugrasp.geometry.pose import Array
from neugrasp.robot.arm_model import JOINTS, ArmModel

PERIOD = 0.008
"""Seconds between two moments: 125 Hz, which every UR controller takes."""
SHORTEST = 0.05
"""Seconds that the shortest motion takes."""
SAFETY = 0.99
"""Share of the limits that is used."""
STRETCHES = 30
"""Times that a motion is stretched; three or four are needed."""


@dataclass(frozen=True)
class Trajectory:
    """Where the joints are to be, and when. Raises `ValueError` where times and joints do not fit."""

    times: Array
    """(n,) seconds from the start, increasing."""
    joints: Array
    """(n, 6) radians."""
    what: str = ""
    """What it is for, in words for people."""

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

    def named(self, what: str) -> Trajectory:
        """The same motion with other words."""
        return Trajectory(self.times, self.joints, what)

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
    """One leg, its time stretched until the moments that are sent keep to the pace."""
    length = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(leg, axis=0)).max(axis=1))])
    if length[-1] < 1e-9:
        return still(leg[0])
    # Moments lie between the positions of the leg: with corners there, the joints would jerk.
    way = CubicSpline(length / length[-1], leg)
    duration = SHORTEST
    for _ in range(STRETCHES):
        times = np.linspace(0, duration, max(2, int(np.ceil(duration / PERIOD)) + 1))
        joints = way(_progress(times / duration))
        joints[0], joints[-1] = leg[0], leg[-1]
        moving = Trajectory(times, joints)
        excess = _excess(moving, model, flange_from_tcp, pace)
        if excess <= 1:
            break
        duration *= excess
    return moving


def _progress(u: Array) -> Array:
    """The share of the way at shares `u` of the time."""
    s: Array = u**3 * (10 - 15 * u + 6 * u * u)
    return np.clip(s, 0, 1)


def _excess(moving: Trajectory, model: ArmModel, flange_from_tcp: Array, pace: Pace) -> float:
    """By which factor a motion must last longer; at most 1 where it is slow enough."""
    step = moving.times[1] - moving.times[0]
    tcp = (model.flange(moving.joints) @ flange_from_tcp)[:, :3, 3]
    rates = np.diff(moving.joints, axis=0) / step
    changes = np.diff(np.vstack([0 * rates[:1], rates, 0 * rates[:1]]), axis=0) / step
    speed = float(np.abs(rates).max()) / pace.joint_speed
    speed = max(speed, float(np.linalg.norm(np.diff(tcp, axis=0), axis=1).max()) / step / pace.tcp_speed)
    return max(speed, float(np.sqrt(np.abs(changes).max() / pace.joint_acceleration))) / SAFETY
