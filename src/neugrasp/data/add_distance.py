"""The mesh distance, and fused grids of few views, for records that were made without them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.npz import npz_arrays, npz_bytes
from neugrasp.data.records import FILES, need_files
from neugrasp.data.truth_file import OPTIONAL, TRUTH_ARRAYS
from neugrasp.data.world import Scene, scene_from_json
from neugrasp.output import whole_file


def add_distance(folder: Path, distance: Callable[[Scene], NDArray[np.float32]]) -> bool:
    """Stores the mesh distance of a record's scene where the record in `folder` has none; whether it did.

    All else in truth.npz stays as it is, and whoever reads it meanwhile finds the old file or the new one.
    Raises `InputError` naming the file that is missing or damaged, `NeuGraspError` where the disk refuses.
    """
    return add_grids(folder, "distance", distance)


def add_grids(folder: Path, name: str, grids: Callable[[Scene], NDArray[np.float32]]) -> bool:
    """Stores an array of that name in truth.npz of the record in `folder`, as `add_distance` does."""
    need_files(folder, FILES)
    path = folder / "truth.npz"
    arrays = npz_arrays(path.read_bytes(), TRUTH_ARRAYS, str(path), optional=OPTIONAL)
    if name in arrays:
        return False
    world = folder / "world.json"
    made = grids(scene_from_json(world.read_text(encoding="utf-8", errors="replace"), world))
    with whole_file(path) as part:
        part.write_bytes(npz_bytes(**arrays, **{name: made.astype(np.float16)}))
    return True
