"""What is timed: photos to grasps, in stages."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import torch

from neugrasp.bench.counting import FlopCounter
from neugrasp.bench.recorder import Cost, Part, Recorder, watched
from neugrasp.data.scene_folder import read_scene
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.model.inputs import prepare
from neugrasp.model.network import NeuGrasp
from neugrasp.observation import Views

PARTS = (
    Part("encode images", "encode", "features"),
    Part("backgrounds", "encode_backgrounds", "features"),
    Part("foreground", "residual.forward", "residual"),
    Part("voxel maps", "encode_scene"),
    Part("volumes", "volumes.forward", "volumes"),
    Part("field query", "sdf_columns", "field"),
    Part("grasp head", "head.forward", "head"),
    Part("ray field", "render_at", "field"),
    Part("ray weights", "render"),
    Part("grid rays", "weights_on_grid"),
)
"""Parts of the network that are stages."""
LOAD, NEW_BACKGROUNDS = "load", "new backgrounds"
OTHER = "other"
"""What no stage accounts for."""


@dataclass(frozen=True)
class Run:
    """One pass through everything."""

    seconds: float
    """Time of the whole, with the device finished."""
    cpu_seconds: float
    """Time of the processor, all threads together: what remains a measure where others compute, too."""
    stages: dict[str, Cost]


class Workload(Protocol):
    """Something to be timed."""

    device: torch.device

    def run(self, recorder: Recorder) -> None:
        """Everything once, every stage in the recorder."""
        ...


def timed(workload: Workload) -> Run:
    """One pass, timed."""
    return _run(workload, None)


def counted(workload: Workload) -> Run:
    """One pass with operations and bytes counted, which makes it slow; on one thread, as others go unseen."""
    counter = FlopCounter()
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with counter:
            return _run(workload, counter)
    finally:
        torch.set_num_threads(threads)


def _run(workload: Workload, counter: FlopCounter | None) -> Run:
    recorder = Recorder(workload.device, counter)
    recorder.clock.finish()
    start, cpu_start = time.perf_counter(), time.process_time()
    workload.run(recorder)
    recorder.clock.finish()
    seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - cpu_start
    stages = recorder.costs()
    stages[OTHER] = Cost(max(0.0, seconds - sum(cost.seconds for cost in stages.values())))
    return Run(seconds, cpu_seconds, stages)


class Detecting:
    """The detector as it is; features of the backgrounds are kept from the first pass on."""

    def __init__(self, detector: NeuGraspDetector, views: Views, bfloat16: bool):
        self.detector, self.views, self.bfloat16 = detector, views, bfloat16
        self.device = detector.compute.device

    def run(self, recorder: Recorder) -> None:
        with watched(self.detector.model, PARTS, recorder), _precision(self.device, self.bfloat16):
            detection = self.detector.detect(self.views)
        for stage, num_bytes in host_bytes(self.views, self.detector.model).items():
            recorder.note(stage, Cost(detection.timing_s[stage], num_bytes=num_bytes))


class Loading:
    """Reading a scene's files."""

    device = torch.device("cpu")

    def __init__(self, folder: Path):
        self.folder = folder

    def run(self, recorder: Recorder) -> None:
        with recorder.stage(LOAD):
            views = read_scene(self.folder)
        files = [
            self.folder / "scene.json",
            *self.folder.glob("images/*"),
            *self.folder.glob("backgrounds/*"),
        ]
        pixels = sum(view.image.nbytes + view.background.nbytes for view in views.frames)
        recorder.note(LOAD, Cost(num_bytes=sum(file.stat().st_size for file in files) + pixels))


class NewBackgrounds:
    """Encoding backgrounds that were never seen."""

    def __init__(self, detector: NeuGraspDetector, views: Views, bfloat16: bool):
        self.model, self.bfloat16, self.device = detector.model, bfloat16, detector.compute.device
        self.inputs = prepare(views, self.model.config.image_size).to(self.device)

    @torch.no_grad()
    def run(self, recorder: Recorder) -> None:
        with _precision(self.device, self.bfloat16):
            model = self.model
            recorder.call(NEW_BACKGROUNDS, model.features, model.encode_backgrounds, self.inputs)


def _precision(device: torch.device, bfloat16: bool) -> AbstractContextManager[object]:
    """Autocast to bfloat16, or whatever the detector does by itself."""
    return torch.autocast(device.type, torch.bfloat16) if bfloat16 else nullcontext()


def host_bytes(views: Views, model: NeuGrasp) -> dict[str, int]:
    """Bytes in and out of the stages outside the network, by stage."""
    photos = sum(view.image.nbytes + view.background.nbytes for view in views.frames)
    tensors = 4 * 3 * len(views) * model.config.image_size**2
    grids = 4 * 7 * model.workspace.resolution**3
    return {"prepare": photos + 2 * tensors, "backgrounds": tensors, "selection": grids}
