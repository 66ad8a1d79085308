"""Work cells as an infrared stereo sensor sees them: dim light and projected dots (docs/benchmark.md)."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType

import numpy as np

from neugrasp.data.world import Cell, Scene
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.renderer import MeshSource, Photo, Renderer, RenderSettings

AMBIENT = 0.035
"""Share of the room's light that the sensor's filter lets through."""
PROJECTOR_PLACE = 0.51
"""Where the projector stands between the cameras, in baselines from the left one."""
PROJECTOR_ENERGY = 60.0
"""Watts (Blender's): dots far brighter than the room, whose noise at few samples would hide them."""
SAMPLES = 4
DOT_SPACING = 4.0
"""Pixels between neighbouring dots, on average."""


def infrared_renderer(threads: int) -> Renderer:
    """A renderer for infrared: no denoising, which would take dots for noise."""
    return Renderer(threads, RenderSettings(samples=SAMPLES, denoise="OFF"))


class PhotoAndInfrared:
    """Photos by one renderer, infrared pairs by another. Use as a context manager, as `Renderer`."""

    def __init__(self, threads: int, settings: RenderSettings):
        self._photos = Renderer(threads, settings)
        self._infrared = infrared_renderer(threads)
        self._closing = ExitStack()

    def __enter__(self) -> PhotoAndInfrared:
        self._closing.enter_context(self._photos)
        self._closing.enter_context(self._infrared)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._closing.close()

    def render(
        self, cell: Cell, scene: Scene | None, library: MeshSource, camera_indices: Sequence[int]
    ) -> list[Photo]:
        """As `Renderer.render`."""
        renderer = self._infrared if "projector" in cell.light else self._photos
        return renderer.render(cell, scene, library, camera_indices)


def infrared_pair(
    cell: Cell, sensor: Camera, workspace: Workspace, baseline: float, max_disparity: int, margin: int = 8
) -> tuple[Cell, int]:
    """The cell with the left and the right camera of a sensor that stands where `sensor` does.

    Both are cut to whole pixels: the left one to the workspace and `margin` pixels around it, the right one
    to what can match it. Column u of the left image looks in the direction of column u + the number that
    comes back of the right one.
    """
    low, high = workspace.table_height - 0.01, workspace.table_height + workspace.photo_height
    pixels, _ = sensor.project(workspace.corners(low, high))
    (left, top), (right, bottom) = pixels.min(axis=0), pixels.max(axis=0)
    x0, x1 = max(0, int(left) - margin), min(sensor.width, int(right) + margin)
    y0, y1 = max(0, int(top) - margin), min(sensor.height, int(bottom) + margin)
    x2 = max(0, x0 - max_disparity)
    moved = replace(sensor, world_from_camera=sensor.world_from_camera @ rigid(translation=(baseline, 0, 0)))
    cameras = (_cut(sensor, x0, y0, x1, y1), _cut(moved, x2, y0, x1, y1))
    place = sensor.world_from_camera @ rigid(translation=(PROJECTOR_PLACE * baseline, 0, 0))
    rng = np.random.default_rng([cell.seed, 5])
    light = {
        **cell.light,
        "strength": cell.light["strength"] * AMBIENT,
        "lamps": [],
        "exposure": 0.0,
        "projector": {
            "world_from_camera": place.tolist(),
            "energy": PROJECTOR_ENERGY * float(rng.uniform(0.9, 1.1)),
            "dot_spacing": DOT_SPACING / float(sensor.intrinsics[0, 0]),
        },
    }
    return replace(cell, cameras=cameras, num_inputs=2, light=light), x0 - x2


def infrared_sensor(sensor: Camera, scale: float) -> Camera:
    """A sensor that stands where `sensor` does, with `scale` times its pixels along each edge."""
    whole = (-0.5, -0.5, sensor.width - 0.5, sensor.height - 0.5)
    return sensor.cropped_and_resized(whole, round(sensor.width * scale), round(sensor.height * scale))


def _cut(camera: Camera, x0: int, y0: int, x1: int, y1: int) -> Camera:
    box = (x0 - 0.5, y0 - 0.5, x1 - 0.5, y1 - 0.5)
    return replace(camera.cropped_and_resized(box, x1 - x0, y1 - y0), sensed=None)
