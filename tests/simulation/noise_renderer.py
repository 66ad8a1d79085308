"""A scene renderer that needs no Blender: noise that depends on what is asked for and on nothing else."""

from __future__ import annotations

import time
import zlib
from collections.abc import Sequence

import numpy as np

from neugrasp.data.world import Cell, Scene, scene_to_json
from neugrasp.simulation.objects import ObjectLibrary


class NoiseRenderer:
    """Takes the place of `Renderer`."""

    def __init__(self, threads: int):
        self.threads = threads

    def __enter__(self) -> NoiseRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def render(
        self, cell: Cell, scene: Scene | None, library: ObjectLibrary, camera_indices: Sequence[int]
    ) -> list[np.ndarray]:
        laid = 0 if scene is None else zlib.crc32(scene_to_json(scene).encode())
        photos = []
        for index in camera_indices:
            camera = cell.cameras[index]
            rng = np.random.default_rng([cell.seed, laid, index])
            photos.append(rng.integers(0, 256, (camera.height, camera.width, 3), dtype=np.uint8))
        return photos


class SlowRenderer(NoiseRenderer):
    """Gives a test time to kill the run."""

    def render(
        self, cell: Cell, scene: Scene | None, library: ObjectLibrary, camera_indices: Sequence[int]
    ) -> list[np.ndarray]:
        time.sleep(0.05)
        return super().render(cell, scene, library, camera_indices)


class FullDisk(NoiseRenderer):
    """Stands for a disk that fills up."""

    def render(
        self, cell: Cell, scene: Scene | None, library: ObjectLibrary, camera_indices: Sequence[int]
    ) -> list[np.ndarray]:
        raise OSError(28, "No space left on device")
