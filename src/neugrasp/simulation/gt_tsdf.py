"""The true surface of a simulated scene, fused from depth images all around it (docs/benchmark.md)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.fusion import Tsdf, fuse, vgn_grid
from neugrasp.geometry.view_sets import on_sphere, vgn_training
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
    return seen_by(world, workspace, scan_cameras(workspace))


def seen_by(world: DepthSource, workspace: Workspace, cameras: Sequence[Camera]) -> Tsdf:
    """What is known of the surface from exact depth images of some cameras."""
    return fuse([world.depth_and_mask(camera)[0] for camera in cameras], cameras, workspace)


def fused_grids(
    world: DepthSource, workspace: Workspace, rng: np.random.Generator, count: int
) -> NDArray[np.float32]:
    """What VGN learns from (count, r, r, r): each grid fused from 1 to 6 views of its own."""
    views = (vgn_training(workspace, rng) for _ in range(count))
    return np.stack([vgn_grid(seen_by(world, workspace, cameras)) for cameras in views])
