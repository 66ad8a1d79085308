"""A stereo depth sensor in a simulated cell: it sees glass and steel as such a sensor does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from neugrasp.data.world import Cell
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import DepthView, DepthViews, Observation
from neugrasp.robot.simulated import SimulatedRobot
from neugrasp.robot.simulated_cameras import PhotoCamera
from neugrasp.simulation.cell_photos import SceneRenderer
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.stereo_matching import StereoConfig
from neugrasp.simulation.stereo_sensor import half_sensor, stereo_on_photo, stereo_view


@dataclass(frozen=True)
class StereoCamera:
    """Infrared pairs of the table as it is now, matched."""

    robot: SimulatedRobot
    cell: Cell
    sensors: Sequence[Camera]
    """Where the left camera stands for each view; whole images."""
    scene_renderer: SceneRenderer
    library: ObjectLibrary
    workspace: Workspace
    config: StereoConfig = field(default_factory=StereoConfig)

    def capture(self) -> DepthViews:
        """One depth image per sensor, cut to the workspace."""
        return DepthViews(tuple(self._view(sensor) for sensor in self.sensors), self.workspace)

    def _view(self, sensor: Camera) -> DepthView:
        left, scene = half_sensor(sensor), self.robot.scene()
        return stereo_view(
            left, self.cell, scene, self.scene_renderer, self.library, self.workspace, self.config
        )


@dataclass(frozen=True)
class StereoRgbdCamera:
    """Photos, and at their pixels the depth of a stereo sensor whose left camera took them."""

    photos: PhotoCamera

    def capture(self) -> Observation:
        """Frames with photo, background and depth."""
        seen, eye = self.photos.capture(), self.photos
        scene = eye.robot.scene()
        frames = tuple(
            replace(
                photo,
                depth=stereo_on_photo(
                    photo.camera, eye.cell, scene, eye.scene_renderer, eye.library, eye.workspace
                ),
            )
            for photo in seen.frames
        )
        return Observation(frames, seen.workspace)
