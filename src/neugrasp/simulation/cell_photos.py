"""Photos of the empty table of a work cell: rendered once, kept on disk, shared by the cell's scenes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from neugrasp.data.scene_folder import read_image
from neugrasp.data.whole_or_nothing import whole_folder
from neugrasp.data.world import Cell, Scene, camera_to_dict
from neugrasp.simulation.objects import ObjectLibrary

Photos = NDArray[np.uint8]
"""(n, s, s, 3)"""


class SceneRenderer(Protocol):
    """What makes photos: `simulation.renderer.Renderer`, or a quick stand-in."""

    def render(
        self, cell: Cell, scene: Scene | None, library: ObjectLibrary, camera_indices: Sequence[int]
    ) -> list[NDArray[np.uint8]]:
        """One photo per camera index of the cell; `scene` None is the empty table."""
        ...


def backgrounds(cell: Cell, folder: Path, scene_renderer: SceneRenderer, library: ObjectLibrary) -> Photos:
    """The empty table from every camera of the cell: read from `folder`, or rendered into it."""
    if not folder.is_dir():
        photos = scene_renderer.render(cell, None, library, range(len(cell.cameras)))
        _write(folder, cell, photos)
    files = [folder / f"{index}.png" for index in range(len(cell.cameras))]
    return np.stack([read_image(file, f"cell {folder.name}") for file in files])


def _write(folder: Path, cell: Cell, photos: Sequence[NDArray[np.uint8]]) -> None:
    """Another worker may have been first; its photos are the same, and stay."""
    with whole_folder(folder) as part:
        for index, photo in enumerate(photos):
            Picture.fromarray(photo).save(part / f"{index}.png")
        cameras = [camera_to_dict(camera) for camera in cell.cameras]
        drawn = {"seed": cell.seed, "num_inputs": cell.num_inputs, "light": cell.light, "table": cell.table}
        content = json.dumps({**drawn, "cameras": cameras}, indent=1) + "\n"
        (part / "cell.json").write_text(content, encoding="utf-8")
