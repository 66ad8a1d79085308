"""What the programs share that add something to the records of a data set: options, processes, a sum."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from neugrasp.errors import NeuGraspError
from neugrasp.run_folder import exit_with_parent, lock_folder

REPORT_EVERY_S = 60.0

Work = Callable[[Path], Counter[str] | None]
"""Adds to the record in a folder; the sums to report, or None where the record had it all."""


def parser(doc: str | None) -> argparse.ArgumentParser:
    """The options that all of them have."""
    made = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("folder", type=Path, metavar="FOLDER")
    made.add_argument("--objects", type=Path, help="a folder of URDF files, as for neugrasp generate")
    made.add_argument("--sets", default="pybullet,glassware", help="object sets where no folder is given")
    made.add_argument("--workers", type=int, default=1, help="processes")
    return made


def sets_of(options: argparse.Namespace) -> tuple[str, ...]:
    """The object sets to open."""
    return tuple(options.sets.split(",")) if options.objects is None else ("folder",)


def over_records(options: argparse.Namespace, work: Work) -> None:
    """Goes through all records, and exits with what went wrong where something did."""
    folders = sorted((options.folder / "scenes").glob("[!.]*"))
    if not folders:
        raise SystemExit(f"{options.folder}: no records in scenes/")
    sums: Counter[str] = Counter()
    failed: list[str] = []
    start = reported = time.monotonic()
    with lock_folder(options.folder / ".adding", "benchmark"), ExitStack() as stack:
        go_through: Callable[..., Iterable[Counter[str] | str | None]] = map
        if options.workers > 1:
            pool = get_context("spawn").Pool(options.workers, exit_with_parent, (os.getpid(),))
            go_through = stack.enter_context(pool).imap_unordered
        for number, result in enumerate(go_through(partial(_timed, work), folders), start=1):
            if isinstance(result, str):
                failed.append(result)
            elif result is not None:
                sums.update(result)
            if time.monotonic() - reported > REPORT_EVERY_S or number == len(folders):
                reported = time.monotonic()
                wall, had = reported - start, number - sums["added to"] - len(failed)
                tell(f"{number} of {len(folders)} records, {had} had it, {len(failed)} failed, {wall:.0f} s")
    each = sums["core ms"] / 1000 / max(sums["added to"], 1)
    tell(f"{dict(sums)}, {each:.2f} s of a core for a record")
    if failed:
        raise SystemExit("\n".join(failed))


def tell(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def _timed(work: Work, folder: Path) -> Counter[str] | str | None:
    """What a record adds to the sums; what went wrong, as a text."""
    start = time.process_time()
    try:
        result = work(folder)
    except NeuGraspError as error:
        # Some of our errors do not survive the way between processes; their text does.
        return f"{folder.name}: {error}"
    if result is None:
        return None
    return result + Counter({"added to": 1, "core ms": round(1000 * (time.process_time() - start))})
