"""The scenes of a training run, in memory, and the order in which steps see them."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from neugrasp.data.records import Record, read_record
from neugrasp.data.shards import INDEX, Shards
from neugrasp.errors import InputError
from neugrasp.geometry.symmetry import Symmetry
from neugrasp.geometry.workspace import Workspace
from neugrasp.training.samples import (
    PreparedRecord,
    Sample,
    Truth,
    prepare_record,
    sample_of,
    truth_of,
)


def read_records(folder: Path) -> Iterator[Record]:
    """Every record in a folder of shards, or in one that `neugrasp generate` wrote, one after the other,
    without its trials: no loss reads them, and those of thousands of scenes are gigabytes.

    Raises `InputError` where there are none or one is damaged.
    """
    if (folder / INDEX).is_file():
        shards = Shards(folder)
        yield from (replace(shards[index], trials=None) for index in range(len(shards)))
        return
    found = [path.parent for path in sorted(folder.rglob("grasps.npz")) if ".tmp" not in str(path)]
    if not found:
        raise InputError(f"{folder}: no records; `neugrasp generate` makes some")
    yield from (replace(read_record(path), trials=None) for path in found)


class TrainingSet:
    """Records prepared once each, and the next sample made ready while a step runs.

    Samples come from records with photos; labels and grids from all.
    """

    def __init__(self, records: list[Record], size: int, seed: int):
        self.records = records
        self.photographed = tuple(index for index, record in enumerate(records) if record.has_photos)
        """Indices of the records with photos."""
        self.size = size
        self.seed = seed
        self.workspace = Workspace()
        self._prepared: dict[int, PreparedRecord] = {}
        self._pool = ThreadPoolExecutor(max_workers=1)
        self._next: tuple[int, Future[Sample]] | None = None

    def __len__(self) -> int:
        return len(self.records)

    def place_at(self, position: int, num: int) -> int:
        """Which of `num` comes at a position of the endless sequence: a new shuffle in every epoch."""
        epoch, place = divmod(position, num)
        return int(np.random.default_rng([self.seed, 1, epoch]).permutation(num)[place])

    def sample_at(self, position: int) -> Sample:
        """The augmented sample at a position; the same whenever it is asked for."""
        rng = np.random.default_rng([self.seed, 2, position])
        index = self.photographed[self.place_at(position, len(self.photographed))]
        return sample_of(self._prepared_record(index), self.workspace, rng)

    def take(self, position: int) -> Sample:
        """`sample_at`, while the one after it is already being made."""
        waiting = self._next
        sample = waiting[1].result() if waiting and waiting[0] == position else self.sample_at(position)
        self._next = (position + 1, self._pool.submit(self.sample_at, position + 1))
        return sample

    def truths_at(self, position: int, count: int) -> list[Truth]:
        """Labels and grids of `count` records from a position on, each moved by a symmetry of its own."""
        moved = []
        for place in range(position, position + count):
            symmetry = Symmetry.random(np.random.default_rng([self.seed, 3, place]))
            record = self.records[self.place_at(place, len(self.records))]
            moved.append(truth_of(record, symmetry, self.workspace))
        return moved

    def plain(self, index: int) -> Sample:
        """A record with photos as it stands, for validation."""
        return sample_of(self._prepared_record(index), self.workspace, None)

    def plain_truth(self, index: int) -> Truth:
        """Labels and grid of a record as they stand, for validation."""
        return truth_of(self.records[index], Symmetry(), self.workspace)

    def close(self) -> None:
        """Stops the background thread."""
        self._pool.shutdown(cancel_futures=True)

    def _prepared_record(self, index: int) -> PreparedRecord:
        if index not in self._prepared:
            self._prepared[index] = prepare_record(self.records[index], self.workspace, self.size)
        return self._prepared[index]
