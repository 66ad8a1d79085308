"""The mesh distance for records that were made without it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.npz import npz_arrays, npz_bytes
from neugrasp.data.records import FILES, need_files
from neugrasp.data.truth_file import TRUTH_ARRAYS
from neugrasp.output import whole_file
from neugrasp.simulation.scene import Scene, scene_from_json


def add_distance(folder: Path, distance: Callable[[Scene], NDArray[np.float32]]) -> bool:
    """Stores the mesh distance of a record's scene where the record in `folder` has none; whether it did.

    All else in truth.npz stays as it is, and whoever reads it meanwhile finds the old file or the new one.
    Raises `InputError` naming the file that is missing or damaged, `NeuGraspError` where the disk refuses.
    """
    need_files(folder, FILES)
    path = folder / "truth.npz"
    arrays = npz_arrays(path.read_bytes(), TRUTH_ARRAYS, str(path), optional=("distance", "stereo"))
    if "distance" in arrays:
        return False
    world = folder / "world.json"
    grid = distance(scene_from_json(world.read_text(encoding="utf-8", errors="replace"), world))
    with whole_file(path) as part:
        part.write_bytes(npz_bytes(**arrays, distance=grid.astype(np.float16)))
    return True
