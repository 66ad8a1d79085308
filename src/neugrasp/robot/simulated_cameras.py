"""What a simulated cell lets be seen: photos, depth images, or, through a door of its own, the truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool
from numpy.typing import NDArray

from neugrasp.data.world import Body, Cell
from neugrasp.execution import SUCCESS
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.fusion import Tsdf
from neugrasp.geometry.pose import Array
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import DepthView, DepthViews, Observation, View, Views
from neugrasp.robot.simulated import SimulatedRobot
from neugrasp.simulation.batched_trials import execute_each
from neugrasp.simulation.cell_photos import Photos, SceneRenderer
from neugrasp.simulation.gt_tsdf import scan
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World

Depth = NDArray[np.float32]
DepthFilter = Callable[[Depth], Depth]
"""From an exact depth image to what a sensor would measure."""


@dataclass(frozen=True)
class PhotoCamera:
    """Photos of the table as it is now."""

    robot: SimulatedRobot
    cell: Cell
    backgrounds: Photos
    """The empty table from every input camera of the cell."""
    scene_renderer: SceneRenderer
    library: ObjectLibrary
    workspace: Workspace

    def capture(self) -> Views:
        """The input views of the cell."""
        indices = range(self.cell.num_inputs)
        photos = self.scene_renderer.render(self.cell, self.robot.scene(), self.library, indices)
        return Views(
            tuple(
                View(self.cell.cameras[i], photo, self.backgrounds[i], name=f"view {i}")
                for i, photo in zip(indices, photos, strict=True)
            ),
            self.workspace,
        )


@dataclass(frozen=True)
class DepthCamera:
    """Depth images of the table as it is now: exact, or as a filter makes them."""

    world: World
    cameras: Sequence[Camera]
    measured: DepthFilter | None = None

    def capture(self) -> DepthViews:
        """One depth image per camera."""
        exact = [self.world.depth_and_mask(camera)[0] for camera in self.cameras]
        depths = exact if self.measured is None else [self.measured(depth) for depth in exact]
        views = tuple(DepthView(c, depth=d) for d, c in zip(depths, self.cameras, strict=True))
        return DepthViews(views, self.world.workspace)


@dataclass(frozen=True)
class RgbdCamera:
    """Photos and depth images from the same places."""

    photos: PhotoCamera
    depths: DepthCamera

    def capture(self) -> Observation:
        """Frames with photo, background and depth."""
        photos, depths = self.photos.capture(), self.depths.capture()
        frames = tuple(
            replace(photo, depth=depth.depth)
            for photo, depth in zip(photos.frames, depths.frames, strict=True)
        )
        return Observation(frames, photos.workspace)


@dataclass(frozen=True)
class Truth:
    """The true surface: for measuring sticks that say so, and for nobody else."""

    tsdf: Tsdf
    workspace: Workspace
    holds: Callable[[Array], Bool[np.ndarray, " n"]]
    """Of TCP poses (n, 4, 4), workspace frame, which hold something when physics tries them. Nothing has
    moved afterwards. For as long as the table stays as it is."""


class TruthCamera:
    """The only way to the truth. Looks anew only when something has moved."""

    def __init__(self, world: World):
        self._world = world
        self._seen: tuple[tuple[Body, ...], Truth] | None = None

    def capture(self) -> Truth:
        """The surface from 18 exact depth images all around."""
        bodies = self._world.bodies()
        if self._seen is None or self._seen[0] != bodies:
            workspace = self._world.workspace
            self._seen = (bodies, Truth(scan(self._world, workspace), workspace, self._holds))
        return self._seen[1]

    def _holds(self, poses: Array) -> Bool[np.ndarray, " n"]:
        trials = execute_each(self._world, poses)
        return np.array([trial.reason == SUCCESS for trial in trials], dtype=np.bool_)
