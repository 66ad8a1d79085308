"""Stores the mesh distance (docs/data_format.md) in the records of a data set that was made without it.

    python benchmarks/add_distance.py FOLDER [--objects DIR] [--sets pybullet,glassware] [--workers N]

FOLDER is a data set of `neugrasp generate`, which may be writing to it at the same time. Records that have it
are left alone, so a run that was stopped goes on where it was. Each record is changed at once or not at all.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from neugrasp.data.records import add_distance
from neugrasp.errors import NeuGraspError
from neugrasp.geometry.workspace import Workspace
from neugrasp.long_runs import held
from neugrasp.simulation.mesh_distance import Grid, mesh_distance
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.scene import Scene


def add(folder: Path, sets: list[str], objects: Path | None) -> float | str | None:
    """The processor seconds that a record took, None where it had its mesh distance, or what went wrong."""
    library, workspace = ObjectLibrary.open(sets, objects), Workspace()

    def distance(scene: Scene) -> Grid:
        return mesh_distance(scene.bodies, library, workspace)

    start = time.process_time()
    try:
        return time.process_time() - start if add_distance(folder, distance) else None
    except NeuGraspError as error:
        # Some of our errors do not survive the way between processes; their text does.
        return str(error)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--objects", type=Path, help="a folder of URDF files, as for neugrasp generate")
    parser.add_argument("--sets", default="pybullet,glassware", help="object sets where no folder is given")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    options = parser.parse_args()
    folders = sorted((options.folder / "scenes").glob("[!.]*"))
    if not folders:
        raise SystemExit(f"{options.folder}: no records in scenes/")
    sets = options.sets.split(",") if options.objects is None else ["folder"]
    added: list[float] = []
    failed: list[str] = []
    start = time.monotonic()
    with held(options.folder / ".adding", "add_distance"), ExitStack() as stack:
        go_through: Callable[..., Iterable[float | str | None]] = map
        if options.workers > 1:
            go_through = stack.enter_context(get_context("spawn").Pool(options.workers)).imap_unordered
        for result in go_through(partial(add, sets=sets, objects=options.objects), folders):
            if isinstance(result, str):
                failed.append(result)
            elif result is not None:
                added.append(result)
    wall = time.monotonic() - start
    seconds = sum(added) / max(len(added), 1)
    sys.stdout.write(
        f"{len(folders)} records: {len(added)} given their mesh distance, "
        f"{len(folders) - len(added) - len(failed)} had it, {len(failed)} failed; "
        f"{seconds:.2f} s of a core each, {wall:.0f} s in all\n"
    )
    if failed:
        raise SystemExit("\n".join(failed))


if __name__ == "__main__":
    main()
