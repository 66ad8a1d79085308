"""Stores what VGN learns from in the records of a data set: grids fused from exact depth of few views.

    python benchmarks/add_fused.py FOLDER [--objects DIR] [--sets pybullet,glassware] [--workers N]
        [--grids 4]

Scenes are rebuilt from world.json, and looked at with PyBullet's depth from 1 to 6 places for each grid
(docs/data_format.md). FOLDER is a data set of `neugrasp generate`, which may be writing to it at the same
time. Records that have them are left alone, so a run that was stopped goes on where it was.
"""

from __future__ import annotations

from collections import Counter
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from over_records import over_records, parser, sets_of

from neugrasp.data.add_distance import add_grids
from neugrasp.data.world import Scene
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.gt_tsdf import fused_grids
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World


@lru_cache(maxsize=1)
def world_of(sets: tuple[str, ...], objects: Path | None) -> World:
    return World(Workspace(), ObjectLibrary.open(sets, objects))


def add(folder: Path, sets: tuple[str, ...], objects: Path | None, grids: int) -> Counter[str] | None:
    def fused(scene: Scene) -> np.ndarray:
        world = world_of(sets, objects)
        world.reset(scene)
        return fused_grids(world, world.workspace, np.random.default_rng([scene.seed, 6]), grids)

    return Counter() if add_grids(folder, "fused", fused) else None


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--grids", type=int, default=4, help="for each record, each of views of its own")
    chosen = options.parse_args()
    work = partial(add, sets=sets_of(chosen), objects=chosen.objects, grids=chosen.grids)
    over_records(chosen, work)


if __name__ == "__main__":
    main()
