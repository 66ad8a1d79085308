"""Stores the mesh distance (docs/data_format.md) in the records of a data set that was made without it.

    python benchmarks/add_distance.py FOLDER [--objects DIR] [--sets pybullet,glassware] [--workers N]

FOLDER is a data set of `neugrasp generate`, which may be writing to it at the same time. Records that have it
are left alone, so a run that was stopped goes on where it was. Each record is changed at once or not at all.
"""

from __future__ import annotations

from collections import Counter
from functools import partial
from pathlib import Path

from over_records import over_records, parser, sets_of

from neugrasp.data.add_distance import add_distance
from neugrasp.data.world import Scene
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.mesh_distance import Grid, mesh_distance
from neugrasp.simulation.objects import ObjectLibrary


def add(folder: Path, sets: tuple[str, ...], objects: Path | None) -> Counter[str] | None:
    library, workspace = ObjectLibrary.open(sets, objects), Workspace()

    def distance(scene: Scene) -> Grid:
        return mesh_distance(scene.bodies, library, workspace)

    return Counter() if add_distance(folder, distance) else None


def main() -> None:
    options = parser(__doc__).parse_args()
    over_records(options, partial(add, sets=sets_of(options), objects=options.objects))


if __name__ == "__main__":
    main()
