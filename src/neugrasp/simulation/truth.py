"""The true surface of a simulated scene, fused from depth images all around it (method.md A4)."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.fusion import Tsdf, fuse
from neugrasp.geometry.view_sets import on_sphere
from neugrasp.geometry.workspace import Workspace

RADIUS = 0.6
"""Metres from the middle of the table."""
POLAR_DEG = (22.5, 45.0, 67.5)
NUM_AZIMUTHS = 6


class DepthSource(Protocol):
    """A world that can be looked at."""

    def depth_and_mask(self, camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.int16]]:
        """z-depth in metres and the mask of what is seen."""
        ...


def scan_cameras(workspace: Workspace) -> tuple[Camera, ...]:
    """The 18 cameras of the evaluation's ground truth, workspace frame."""
    azimuths = 2 * np.pi * np.arange(NUM_AZIMUTHS) / NUM_AZIMUTHS
    return tuple(on_sphere(workspace, RADIUS, np.deg2rad(p), a) for p in POLAR_DEG for a in azimuths)


def scan(world: DepthSource, workspace: Workspace) -> Tsdf:
    """The world's surface as it stands now."""
    cameras = scan_cameras(workspace)
    return fuse([world.depth_and_mask(camera)[0] for camera in cameras], cameras, workspace)
