"""The scene of a figure: its photos, and what is known of the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.scene_folder import read_scene
from neugrasp.data.truth_file import truth_from_bytes
from neugrasp.demo.bundled import demo_scenes
from neugrasp.errors import InputError
from neugrasp.observation import View, Views


@dataclass(frozen=True)
class Truth:
    """What the generator knows of a scene."""

    tsdf: NDArray[np.float32]
    """(r, r, r) in [-1, 1], -1 where unseen."""
    masks: NDArray[np.int8]
    """(n, h, w): -1 beyond the table, 0 table, i + 1 object i."""


@dataclass(frozen=True)
class FigureInput:
    """A scene, one of its photos, and the truth where it is known."""

    name: str
    views: Views
    index: int
    """Index of the photo that is drawn."""
    truth: Truth | None

    @property
    def view(self) -> View:
        """The photo that is drawn."""
        return self.views.frames[self.index]


def open_figure_input(name: str, index: int) -> FigureInput:
    """A bundled scene by name, or a scene folder. Raises `InputError` where it or its photo is not there."""
    bundled = {scene.name: scene.folder for scene in demo_scenes()}
    folder = bundled.get(name, Path(name))
    if not folder.is_dir():
        raise InputError(f"--scene {name}: neither a folder nor a bundled scene ({', '.join(bundled)})")
    views = read_scene(folder)
    if not 0 <= index < len(views):
        raise InputError(f"--view {index}: {name} has the photos 0 to {len(views) - 1}")
    return FigureInput(folder.name, views, index, _truth(folder / "truth.npz"))


def _truth(file: Path) -> Truth | None:
    if not file.is_file():
        return None
    arrays = truth_from_bytes(file.read_bytes(), str(file))
    return Truth(np.asarray(arrays["tsdf"], dtype=np.float32), arrays["masks"])
