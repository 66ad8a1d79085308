"""A stereo depth sensor in a simulated cell: it sees glass and steel as such a sensor does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from neugrasp.baselines.stereo_matching import Grey, StereoConfig, stereo_depth
from neugrasp.data.world import Cell
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import DepthView, DepthViews
from neugrasp.robot.simulated import SimulatedRobot
from neugrasp.simulation.cell_photos import Photographer
from neugrasp.simulation.infrared import infrared_pair, infrared_sensor
from neugrasp.simulation.objects import ObjectLibrary

SCALE = 0.5
"""Pixels of the infrared images for each of the sensor's: half of them measure a table to a millimetre."""


@dataclass(frozen=True)
class StereoCamera:
    """Infrared pairs of the table as it is now, matched."""

    robot: SimulatedRobot
    cell: Cell
    sensors: Sequence[Camera]
    """Where the left camera stands for each view; whole images."""
    photographer: Photographer
    library: ObjectLibrary
    workspace: Workspace
    config: StereoConfig = field(default_factory=StereoConfig)

    def look(self) -> DepthViews:
        """One depth image per sensor, cut to the workspace."""
        return DepthViews(tuple(self._view(sensor) for sensor in self.sensors), self.workspace)

    def _view(self, sensor: Camera) -> DepthView:
        sensor = infrared_sensor(sensor, SCALE)
        config, focal = self.config, float(sensor.intrinsics[0, 0])
        most = int(np.ceil(focal * config.baseline / config.nearest)) + config.window
        pair, offset = infrared_pair(self.cell, sensor, self.workspace, config.baseline, most)
        left, right = self.photographer.render(pair, self.robot.scene(), self.library, (0, 1))
        return DepthView(
            pair.cameras[0], depth=stereo_depth(_grey(left), _grey(right), offset, focal, config)
        )


def _grey(photo: np.ndarray) -> Grey:
    grey: Grey = photo.astype(np.float32).mean(axis=-1)
    return grey
