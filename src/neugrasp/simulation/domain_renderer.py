"""Photos as the camera of a domain takes them, of what a renderer shows without error."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace

import numpy as np
from jaxtyping import UInt8
from numpy.typing import NDArray
from PIL import Image as Picture
from scipy.ndimage import map_coordinates

from neugrasp.data.world import Cell, Scene
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.lens import Lens
from neugrasp.simulation.cell_photos import SceneRenderer
from neugrasp.simulation.domain import Domain, DomainLens, Sensor
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.renderer import Renderer, RenderSettings
from neugrasp.srgb import displayed, linear


@dataclass(frozen=True)
class DomainRenderer:
    """A renderer of cells whose cameras are those that the reader believes in."""

    domain: Domain
    renders: SceneRenderer

    def render(
        self, cell: Cell, scene: Scene | None, library: ObjectLibrary, camera_indices: Sequence[int]
    ) -> list[NDArray[np.uint8]]:
        """One photo per camera index of the cell; `scene` None is the empty table, as it was earlier."""
        photos = self.renders.render(self._as_it_is(cell, scene is None), scene, library, camera_indices)
        bodies = "" if scene is None else json.dumps([asdict(body) for body in scene.bodies])
        drawn = int(hashlib.sha256(bodies.encode()).hexdigest()[:8], 16)
        return [
            self._developed(photo, cell.cameras[i], np.random.default_rng([cell.seed, drawn, i]))
            for i, photo in zip(camera_indices, photos, strict=True)
        ]

    def _as_it_is(self, cell: Cell, is_empty: bool) -> Cell:
        """The cell with the cameras and the light that there are."""
        if self.domain.hand_eye is not None:
            errors = map(self.domain.hand_eye.believed_from_true, range(len(cell.cameras)))
            cameras = [
                replace(camera, world_from_camera=camera.world_from_camera @ error)
                for camera, error in zip(cell.cameras, errors, strict=True)
            ]
            cell = replace(cell, cameras=tuple(cameras))
        earlier = self.domain.earlier
        if earlier is None or not is_empty:
            return cell
        light = {
            **cell.light,
            "rotation": cell.light["rotation"] + earlier.turn,
            "strength": cell.light["strength"] * earlier.panorama,
            "lamps": [
                {**lamp, "irradiance": lamp["irradiance"] * earlier.lamps} for lamp in cell.light["lamps"]
            ],
        }
        # The renderer's noise is another, too, as it is an hour later.
        return replace(cell, light=light, seed=cell.seed + 1)

    def _developed(
        self, photo: UInt8[np.ndarray, "h w 3"], camera: Camera, rng: np.random.Generator
    ) -> UInt8[np.ndarray, "h w 3"]:
        if self.domain.lens is not None:
            photo = bent(photo, camera, self.domain.lens)
        return photo if self.domain.sensor is None else sensed(photo, self.domain.sensor, rng)


def bent(photo: UInt8[np.ndarray, "h w 3"], camera: Camera, lens: DomainLens) -> UInt8[np.ndarray, "h w 3"]:
    """A pinhole's photo as the lens shows it."""
    glass = Lens(camera.intrinsics, camera.width, camera.height, (*lens.radial, 0.0), lens.tangential)
    straight = glass.ideal(camera.pixel_grid().reshape(-1, 2)).reshape(*photo.shape[:2], 2)
    column, row = np.moveaxis(straight, -1, 0)
    channels = [
        map_coordinates(photo[..., channel].astype(np.float32), (row, column), order=1, mode="nearest")
        for channel in range(3)
    ]
    return np.stack(channels, axis=-1).round().astype(np.uint8)


def sensed(
    photo: UInt8[np.ndarray, "h w 3"], sensor: Sensor, rng: np.random.Generator
) -> UInt8[np.ndarray, "h w 3"]:
    """A photo as a small sensor takes it and a JPEG keeps it."""
    height, width = photo.shape[:2]
    v, u = np.mgrid[:height, :width] - np.array([(height - 1) / 2, (width - 1) / 2]).reshape(2, 1, 1)
    from_middle = (u**2 + v**2) / ((height**2 + width**2) / 4)
    light = linear(photo / 255) * (1 - sensor.vignetting * from_middle)[..., None]
    light += rng.normal(size=light.shape) * np.sqrt(sensor.shot * light + sensor.read**2)
    stream = io.BytesIO()
    pixels = (255 * displayed(light.clip(0, 1))).round().astype(np.uint8)
    Picture.fromarray(pixels).save(stream, "JPEG", quality=sensor.jpeg)
    stream.seek(0)
    return np.asarray(Picture.open(stream).convert("RGB"))


@contextmanager
def domain_renderer(domain: Domain, settings: RenderSettings, threads: int = 2) -> Iterator[SceneRenderer]:
    """A Blender process that takes the photos of a domain."""
    if domain.tone is not None:
        settings = replace(settings, view_transform=domain.tone)
    with Renderer(threads, settings) as renderer:
        yield DomainRenderer(domain, renderer)
