"""Depth as a stereo sensor measures it of a simulated cell: infrared pairs rendered, then matched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from neugrasp.data.world import Cell, Scene
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.view_sets import FOCAL
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import Depth, DepthView
from neugrasp.simulation.cell_photos import SceneRenderer
from neugrasp.simulation.infrared import infrared_pair, infrared_sensor
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.stereo_matching import Grey, StereoConfig, stereo_depth

SCALE = 0.5
"""Pixels of the infrared images for each of the sensor's: half of them measure a table to a millimetre."""


def stereo_view(
    sensor: Camera, cell: Cell, scene: Scene, scene_renderer: SceneRenderer, library: ObjectLibrary,
    workspace: Workspace, config: StereoConfig | None = None,
) -> DepthView:  # fmt: skip
    """What a sensor whose left camera is `sensor`, a whole image, measures; cut to the workspace."""
    config = config or StereoConfig()
    focal = float(sensor.intrinsics[0, 0])
    most = int(np.ceil(focal * config.baseline / config.nearest)) + config.window
    pair, offset = infrared_pair(cell, sensor, workspace, config.baseline, most)
    left, right = scene_renderer.render(pair, scene, library, (0, 1))
    return DepthView(pair.cameras[0], depth=stereo_depth(_grey(left), _grey(right), offset, focal, config))


def stereo_on_photo(
    camera: Camera, cell: Cell, scene: Scene, scene_renderer: SceneRenderer, library: ObjectLibrary,
    workspace: Workspace,
) -> Depth:  # fmt: skip
    """z-depth (h, w) at the pixels of a photo that was cropped to the workspace, 0 where not measured."""
    return at_pixels_of(
        camera, stereo_view(sensor_around(camera), cell, scene, scene_renderer, library, workspace)
    )


def half_sensor(sensor: Camera) -> Camera:
    """The infrared camera that stands where a whole photo was taken from."""
    return infrared_sensor(sensor, SCALE)


def sensor_around(camera: Camera) -> Camera:
    """The infrared camera that stands where a cropped photo was taken from: as many pixels to the metre as
    `half_sensor`, and room to the left and right of the crop for what its pixels match."""
    scale = SCALE * FOCAL / float(camera.intrinsics[0, 0])
    width, height = camera.width, camera.height
    box = (-0.5 - width / 2, -0.5, 1.5 * width - 0.5, height - 0.5)
    wide = camera.cropped_and_resized(box, round(2 * width * scale), round(height * scale))
    return replace(wide, sensed=None)


def at_pixels_of(camera: Camera, view: DepthView) -> Depth:
    """The depth of a view from the same place at the nearest pixels (h, w) of `camera`; 0 beside it, and
    where the crop reaches past the photo."""
    rays = camera.unproject(camera.pixel_grid(), np.ones((camera.height, camera.width)))
    column, row = np.moveaxis(np.rint(view.camera.project(rays)[0]).astype(np.int64), -1, 0)
    inside = (column >= 0) & (column < view.camera.width) & (row >= 0) & (row < view.camera.height)
    inside &= camera.measured_pixels()
    found = view.depth[np.where(inside, row, 0), np.where(inside, column, 0)]
    depth: Depth = np.where(inside, found, 0).astype(np.float32)
    return depth


def _grey(photo: np.ndarray) -> Grey:
    grey: Grey = photo.astype(np.float32).mean(axis=-1)
    return grey
