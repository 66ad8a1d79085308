"""What arm and gripper are about to do, in words and as plain data, in the world of the cell file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from neugrasp.geometry.pose import to_quaternion
from neugrasp.robot.attended import Step
from neugrasp.robot.motion import Motion

WAYPOINTS = 5
"""Moments of a motion that are printed, its ends among them."""


def described(step: Step, planner: Motion) -> str:
    """One line: what, how long, how fast, where to."""
    if step.motion is None:
        if step.grasp is not None:
            return step.what
        return f"{step.what} to {1000 * step.opening:.0f} mm, with {step.force:.0f} N"
    speed, turning = speeds(step, planner)
    x, y, z = planner.tcp(step.motion.joints[-1])[:3, 3].tolist()
    ends = ", ends on contact" if step.until_contact else ""
    return (
        f"{step.what}: {step.motion.duration:.1f} s, TCP to ({x:.3f}, {y:.3f}, {z:.3f}) m at up to "
        f"{speed:.2f} m/s, joints at up to {turning:.0f} degrees/s{ends}"
    )


def speeds(step: Step, planner: Motion) -> tuple[float, float]:
    """The most that a motion has: m/s of the TCP, degrees/s of any joint."""
    assert step.motion is not None
    steps = np.diff(step.motion.times)
    way = np.linalg.norm(np.diff(planner.tcp(step.motion.joints)[:, :3, 3], axis=0), axis=1)
    turns = np.abs(np.diff(step.motion.joints, axis=0)).max(axis=1)
    return float((way / steps).max()), float(np.rad2deg((turns / steps).max()))


def listed(steps: Sequence[Step], planner: Motion) -> list[str]:
    """Every step with a number, and below each motion the joints and the TCP at some of its moments."""
    lines = []
    for number, step in enumerate(steps, start=1):
        lines.append(f"{number:3}  {described(step, planner)}")
        if step.motion is None:
            continue
        for moment in np.linspace(0, step.motion.duration, WAYPOINTS):
            joints = step.motion.at(float(step.motion.times[0] + moment))
            pose = planner.tcp(joints)
            degrees = " ".join(f"{angle:7.1f}" for angle in np.rad2deg(joints))
            place = " ".join(f"{x:6.3f}" for x in pose[:3, 3])
            turn = " ".join(f"{x:6.3f}" for x in to_quaternion(pose))
            lines.append(f"     {moment:5.2f} s  joints {degrees}  TCP {place}  {turn}")
    return lines


def plain(step: Step, planner: Motion) -> dict[str, Any]:
    """Everything of a step, every moment of a motion among it: seconds, radians, metres, quaternions xyzw."""
    if step.motion is None:
        return {"what": step.what, "opening": step.opening, "force": step.force}
    speed, turning = speeds(step, planner)
    poses = planner.tcp(step.motion.joints)
    return {
        "what": step.what,
        "duration": step.motion.duration,
        "ends_on_contact": step.until_contact,
        "tcp_speed": speed,
        "joint_speed": float(np.deg2rad(turning)),
        "times": step.motion.times.tolist(),
        "joints": step.motion.joints.tolist(),
        "tcp_position": poses[:, :3, 3].tolist(),
        "tcp_quaternion_xyzw": [to_quaternion(pose).tolist() for pose in poses],
    }
