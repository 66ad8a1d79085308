"""What the routes call: cells, detections, and the state of the server."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

from neugrasp.data.photo_files import Photo
from neugrasp.detection.contract import Detection, Detector, Stopwatch
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.detection.options import DetectorOptions, Steering
from neugrasp.detection.registry import photo_detector
from neugrasp.detection.steering import check_mask, steered
from neugrasp.doctor.examination import Diagnosis, KnownTable, examine_read
from neugrasp.doctor.findings import Level
from neugrasp.doctor.photo_tags import findings_of
from neugrasp.errors import InputError
from neugrasp.observation import Views
from neugrasp.server.answers import Wanted
from neugrasp.server.command import Serve
from neugrasp.server.gate import Refusal, Visit
from neugrasp.server.intake import Cell, Seen, cell_of, seen_at
from neugrasp.server.meters import Meters
from neugrasp.server.workers import Busy, Gone, TooSlow, Workers


class Red(InputError):
    """The doctor finds that grasps would fail."""

    def __init__(self, diagnosis: Diagnosis):
        super().__init__("the doctor says red; ?force=true predicts all the same")
        self.diagnosis = diagnosis


@dataclass(frozen=True)
class Found:
    """A detection, and how it came about."""

    detection: Detection
    diagnosis: Diagnosis
    views: Views
    seconds: Mapping[str, float]


class Service:
    """One server's detectors, cells and counters."""

    def __init__(self, options: Serve):
        """Loads the weights. Raises `InputError` where an option cannot be used."""
        self.options = options
        self._most_pixels = round(options.megapixels * 1e6)
        spec, each = photo_detector(options.detector, "a request"), DetectorOptions.of(options)
        self.facts = {
            "detector": options.detector,
            "gripper": options.gripper,
            "devices": list(options.devices),
            "precision": options.precision,
            **spec.facts(each),
        }
        detectors = [spec.load(replace(each, device=device)) for device in options.devices]
        self.workers = Workers([_roomy(detector, options.cells) for detector in detectors], options.queue)
        self.cells: dict[str, Cell] = {}
        self.meters = Meters()
        self.meters.watch(lambda: self.workers.held, lambda: len(self.cells), self._backgrounds)
        self.is_ready = True
        self.answered = 0
        """Detections so far."""
        # Photos are decoded beside the event loop, and no more at a time than requests are held.
        self.readers = ThreadPoolExecutor(min(4, options.queue), "reader")

    def enter(self, staying: ExitStack) -> None:
        """A place for a request. Raises `Refusal` where there is none."""
        if not self.is_ready:
            raise Refusal(503, "draining", "this server is going down", **{"retry-after": "5"})
        try:
            staying.enter_context(self.workers.room())
        except Busy as busy:
            raise Refusal(429, "busy", str(busy), **{"retry-after": str(busy.retry_after_s)}) from None

    async def keep(self, name: str, scene: bytes, backgrounds: Sequence[Photo]) -> Cell:
        """Keeps a cell under a name, in place of the one that had it, with the features of its backgrounds.

        Raises `InputError` where it cannot be used or there is no room for another one.
        """
        if name not in self.cells and len(self.cells) >= self.options.cells:
            known = ", ".join(sorted(self.cells))
            raise Refusal(
                409, "too many cells", f"all {self.options.cells} cells are taken ({known}); DELETE one"
            )
        cell = await self._read(lambda: cell_of(scene, backgrounds, self._most_pixels))
        empty = cell.empty()
        cell = replace(cell, table=await self._read(lambda: KnownTable.of(empty)))
        await self.workers.everywhere(
            lambda detector: detector.remember(empty) if isinstance(detector, NeuGraspDetector) else None
        )
        self.cells[name] = cell
        return cell

    def cell(self, name: str) -> Cell:
        """Raises `Refusal` where there is none of that name."""
        if name not in self.cells:
            raise Refusal(404, "no such cell", f"there is no cell {name!r}; PUT /v1/cells/{name} makes it")
        return self.cells[name]

    async def detect(
        self,
        scene: Cell | tuple[bytes, Sequence[Photo]],
        images: Sequence[Photo],
        steering: Steering,
        wanted: Wanted,
        visit: Visit,
        gone: Callable[[], Awaitable[Any]],
    ) -> Found:
        """Grasps of a scene at a cell that is kept, or at one that comes along.

        Raises `InputError` where it cannot be used, `Red` where the doctor says so, `Refusal` where it takes
        too long or nobody waits any more.
        """
        watch = Stopwatch()
        seen = await self._read(lambda: self._seen(scene, images, steering, watch))
        # The doctor's look takes a tenth of a detection: they go side by side.
        looking = asyncio.ensure_future(self._read(lambda: self._look(seen, wanted, visit, watch)))
        looking.add_done_callback(lambda look: look.cancelled() or look.exception())
        try:
            detection, waited = await self._found(seen, steering, visit, looking, gone)
            diagnosis: Diagnosis = await looking
        finally:
            looking.cancel()
        watch.seconds["queue"] = waited
        self.answered += 1
        self.meters.found(len(detection.grasps), detection.rejected)
        self.meters.spent({**watch.seconds, **detection.timing_s})
        visit.facts["grasps"] = len(detection.grasps)
        return Found(detection, diagnosis, seen.views, watch.seconds)

    def _seen(
        self,
        scene: Cell | tuple[bytes, Sequence[Photo]],
        images: Sequence[Photo],
        steering: Steering,
        watch: Stopwatch,
    ) -> Seen:
        with watch.stage("decode"):
            cell = scene if isinstance(scene, Cell) else cell_of(*scene, self._most_pixels)
            seen = seen_at(cell, images, self._most_pixels)
            check_mask(steering, seen.views)
            return seen

    def _look(self, seen: Seen, wanted: Wanted, visit: Visit, watch: Stopwatch) -> Diagnosis:
        """The doctor's. Raises `Red`."""
        with watch.stage("examine"):
            diagnosis = examine_read(seen.views, tags=findings_of(seen.told), table=seen.table)
        self.meters.judged(diagnosis.level.word)
        visit.facts["doctor"] = diagnosis.level.word
        if diagnosis.level == Level.RED and not wanted.force:
            raise Red(diagnosis)
        return diagnosis

    async def _found(
        self,
        seen: Seen,
        steering: Steering,
        visit: Visit,
        looking: asyncio.Future[Diagnosis],
        gone: Callable[[], Awaitable[Any]],
    ) -> tuple[Detection, float]:
        """A detection, and the seconds that it waited. Raises as `detect`."""
        left = self.options.patience_s - (time.perf_counter() - visit.begun)
        try:
            return await self.workers.run(
                lambda detector: steered(detector.detect(seen.views), steering, seen.views),
                left,
                lambda: _needless(looking, gone),
            )
        except TooSlow:
            raise Refusal(504, "slow answer", f"no answer within {self.options.patience_s:g} s") from None
        except Gone:
            if looking.done():
                looking.result()
            raise Refusal(499, "client gone", "nobody waits for the answer") from None

    def close(self) -> None:
        """Ends when what has begun is finished."""
        self.readers.shutdown(wait=True, cancel_futures=True)
        self.workers.close()

    async def _read(self, work: Any) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self.readers, work)

    def _backgrounds(self) -> tuple[int, int]:
        """How often features of backgrounds were found, and how often they were made."""
        memories = [d.memory for d in self.workers.detectors if isinstance(d, NeuGraspDetector)]
        return sum(memory.hits for memory in memories), sum(memory.misses for memory in memories)


async def _needless(looking: asyncio.Future[Any], gone: Callable[[], Awaitable[Any]]) -> None:
    """Returns as soon as nobody wants a detection: the client has gone, or the doctor refuses."""
    leaving = asyncio.ensure_future(gone())
    try:
        await asyncio.wait({looking, leaving}, return_when=asyncio.FIRST_COMPLETED)
        if not leaving.done() and looking.exception() is None:
            await leaving
    finally:
        leaving.cancel()


def _roomy(detector: Detector[Any], cells: int) -> Detector[Any]:
    """The detector with room for the backgrounds of all cells, and of a scene that comes whole."""
    if isinstance(detector, NeuGraspDetector):
        detector.memory.cells = cells + 1
    return detector
