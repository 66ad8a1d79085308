"""The ways in which the numbers of a pose can have been meant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from neugrasp.data.camera_checks import OPENCV_FROM_OPENGL
from neugrasp.doctor.findings import Problem
from neugrasp.doctor.messages import (
    BODY_FRAME,
    INVERTED,
    INVERTED_OPENGL,
    INVERTED_ROTATION,
    OPENGL,
    QUATERNION_ORDER,
)
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, from_quaternion, inverse, rigid, to_quaternion
from neugrasp.geometry.workspace import Workspace

BODY_FROM_OPENCV = rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""ROS bodies have x forward, y left, z up."""


@dataclass(frozen=True)
class PoseConvention:
    """One way to understand the poses."""

    frames: Problem | None
    """What is wrong with the axes or the direction of the poses; None as written."""
    mend: Callable[[Array], Array]
    """`world_from_camera` of a pose as written."""
    camera_unit: float = 1.0
    """Metres in one unit of the cameras' translations."""
    workspace_unit: float = 1.0
    workspace_inverted: bool = False

    @property
    def mistakes(self) -> int:
        """How many things are wrong; both units wrong in the same way are one thing."""
        units = {self.camera_unit, self.workspace_unit} - {1.0}
        return int(self.frames is not None) + int(self.workspace_inverted) + len(units)

    def workspace(self, written: Workspace) -> Workspace:
        """The cube, understood this way."""
        pose = _scaled(written.world_from_workspace, self.workspace_unit)
        return replace(written, world_from_workspace=inverse(pose) if self.workspace_inverted else pose)

    def camera(self, written: Camera) -> Camera:
        """A camera, understood this way."""
        return replace(
            written, world_from_camera=self.mend(_scaled(written.world_from_camera, self.camera_unit))
        )

    @property
    def words(self) -> str:
        """The mistakes."""
        words = [self.frames.name[0].lower() + self.frames.name[1:]] if self.frames else []
        if self.workspace_inverted:
            words.append("the workspace is inverted")
        if self.camera_unit != 1:
            words.append(f"poses in {UNIT_NAMES[self.camera_unit]}")
        if self.workspace_unit != 1:
            words.append(f"world_from_workspace in {UNIT_NAMES[self.workspace_unit]}")
        return ", ".join(words) or "nothing is changed"


def _scaled(pose: Array, unit: float) -> Array:
    scaled = pose.copy()
    scaled[:3, 3] *= unit
    return scaled


def _with_rotation(pose: Array, quaternion_xyzw: Array) -> Array:
    return from_quaternion(quaternion_xyzw, pose[:3, 3])


UNIT_PAIRS = [(1.0, 1.0), (1e-3, 1.0), (1e-3, 1e-3), (1e-2, 1.0), (1e-2, 1e-2), (1.0, 1e-3), (1.0, 1e-2)]
UNIT_NAMES = {1.0: "metres", 1e-2: "centimetres", 1e-3: "millimetres"}
USUAL_FRAMES: list[tuple[Problem | None, Callable[[Array], Array]]] = [
    (None, lambda pose: pose),
    (OPENGL, lambda pose: pose @ OPENCV_FROM_OPENGL),
    (INVERTED, inverse),
    (INVERTED_OPENGL, lambda pose: inverse(pose) @ OPENCV_FROM_OPENGL),
]
RARE_FRAMES: list[tuple[Problem, Callable[[Array], Array]]] = [
    (BODY_FRAME, lambda pose: pose @ BODY_FROM_OPENCV),
    (INVERTED_ROTATION, lambda pose: rigid(pose[:3, :3].T, pose[:3, 3])),
    # Written w x y z and taken for x y z w, and the other way round.
    (QUATERNION_ORDER, lambda pose: _with_rotation(pose, np.roll(to_quaternion(pose), -1))),
    (QUATERNION_ORDER, lambda pose: _with_rotation(pose, np.roll(to_quaternion(pose), 1))),
]
USUAL = [
    PoseConvention(frames, mend, cameras, workspace, inverted)
    for inverted, (cameras, workspace), (frames, mend) in product((False, True), UNIT_PAIRS, USUAL_FRAMES)
]
"""Believed where the cube is seen in no other way."""
RARE = [
    PoseConvention(frames, mend, cameras, workspace)
    for (cameras, workspace), (frames, mend) in product(UNIT_PAIRS, RARE_FRAMES)
]
"""Believed only where the photos of the table confirm them."""
