"""The `neugrasp` program. The only file that prints; heavy parts load when a command needs them."""

from __future__ import annotations

import logging
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Protocol

import tyro

import neugrasp
from neugrasp.bench.command import SpeedTest
from neugrasp.data.command import Pack
from neugrasp.detection.steering import Steering
from neugrasp.doctor.command import Doctor
from neugrasp.doctor.findings import Verdict
from neugrasp.errors import InputError, NeuGraspError
from neugrasp.evaluation.commands import Compare, Evaluate, Failures, Results, Story, Validate
from neugrasp.exporters.command import Export
from neugrasp.figures.command import Figure
from neugrasp.importers.command import Import, PrintBoard
from neugrasp.progress import counted
from neugrasp.report.command import DataSheet
from neugrasp.simulation.command import Generate
from neugrasp.terminal import check_command, next_step, printable, speak_plainly
from neugrasp.viewer.command import Viewer

if TYPE_CHECKING:
    from neugrasp.detection.detector import Detection

log = logging.getLogger(__name__)
ROW = "{:<24} {:>6} {:>6} {:>8} {:>8}  {}"
FOLDERS = """
Every folder holds overlay.png (the photos with the grasps, 1 the best), surface.png (the surface above the
true one), slice.png (a cut through the distance grid), grasps.json, surface.ply and tsdf.npz."""
Folder = Annotated[Path, tyro.conf.arg(metavar="DIR")]


@dataclass(frozen=True)
class Demo:
    """Bundled scenes in, surfaces, grasps and pictures out. Runs on a CPU right after the installation."""

    doing: ClassVar[str] = "surfaces and grasps of four bundled scenes, some seconds each"

    out: Folder = Path("outputs/demo")
    """Where NAME/ is written for every scene."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""

    def run(self) -> Iterator[str]:
        """A table, row by row as it comes, and what to do next."""
        from neugrasp.demo import demo_scenes, run_demo
        from neugrasp.detection.detector import NeuGraspDetector

        began = time.monotonic()
        detector = NeuGraspDetector.load(self.weights, self.gripper)
        scenes = demo_scenes()
        yield ROW.format("scene", "grasps", "best", "width", "seconds", "pictures")
        for scene in counted(scenes, "scenes"):
            start = time.monotonic()
            detection = run_demo(scene, detector, self.out / scene.name)
            yield _row(scene.name, detection, time.monotonic() - start, self.out / scene.name)
        yield f"{len(scenes)} scenes in {time.monotonic() - began:.0f} s, their pictures included."
        yield FOLDERS
        yield next_step("view", self.out / scenes[0].name)
        yield next_step("doctor", "MY_SCENE", why="a capture of your own: docs/capture.md")


@dataclass(frozen=True)
class Predict:
    """Photos of a scene in; grasps.json, surface.ply, tsdf.npz and overlay.png out. The doctor takes a quick
    look first; on red nothing is predicted."""

    doing: ClassVar[str] = "looking at the photos, then predicting, some seconds"

    scene: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCENE")]
    """A scene folder: scene.json, images/, backgrounds/ (docs/data_format.md)."""
    out: Folder
    """Where the files are written: all of them or none."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""
    threshold: float | None = None
    """Score from which a grasp is one; by default the one that the weights were judged with."""
    report: bool = False
    """Write report.html, too: the scene to turn, why candidates fell out, the doctor's verdict."""
    hand_check: bool = True
    """Send grasps as deep as the surface lets the hand, and drop those that it speaks against."""
    steering: Annotated[Steering, tyro.conf.arg(name="")] = field(default_factory=Steering)
    examine: bool = False
    """Let the doctor look at everything first, as `neugrasp doctor` does."""
    force: bool = False
    """Predict even where the doctor says red."""

    def run(self) -> str:
        from neugrasp.report.predict import PredictRun, predict

        run = PredictRun(
            scene=self.scene,
            out=self.out,
            weights=self.weights,
            gripper=self.gripper,
            threshold=self.threshold,
            with_report=self.report,
            hand_check=self.hand_check,
            steering=self.steering,
            is_examined=self.examine,
            is_forced=self.force,
        )
        return predict(run)


@dataclass(frozen=True)
class Train:
    """Trains the network on generated scenes. Goes on with --resume exactly where it stopped."""

    doing: ClassVar[str] = "reading the data, then training"

    data: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="DIR [DIR ...]")]
    """Folders made by `neugrasp generate`, or of shards packed from them."""
    out: Folder
    """Where weights, checkpoints and logs are written."""
    recipe: str = "small"
    """Model, losses and schedule, by name (src/neugrasp/training/recipes.py)."""
    validation: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="DIR [DIR ...]")] = ()
    """Folders to validate on; without any, every twentieth scene is kept aside."""
    init: str | None = None
    """Weights to start from, by name or file; of another network than the recipe's, only the grasp head is
    taken."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Where to compute."""
    steps: int | None = None
    """Instead of the recipe's number of steps."""
    seed: int = 0
    """Of the first weights and of the order of the samples."""
    scenes: int | None = None
    """Train on so many of the scenes, evenly spread over --data; by default on all."""
    resume: bool = False
    """Go on from the last checkpoint in --out."""
    loaders: int = 1
    """Processes that prepare scenes while a step runs; 0: none, so that each step waits for its own."""

    def run(self) -> str:
        import torch

        from neugrasp.training.trainer import TrainRun, train

        if self.device == "cuda" and not torch.cuda.is_available():
            raise InputError("--device cuda: PyTorch sees no CUDA device here; use --device cpu")
        weights = train(
            TrainRun(
                recipe=self.recipe,
                data=self.data,
                out=self.out,
                validation=self.validation,
                init=self.init,
                device=self.device,
                steps=self.steps,
                seed=self.seed,
                scenes=self.scenes,
                resume=self.resume,
                loaders=self.loaders,
            )
        )
        return f"{weights}\n{next_step('predict', 'MY_SCENE', '--weights', weights, '--out', 'out')}"


class Command(Protocol):
    """Options as fields, and what is done with them; what it returns is printed, or what it yields."""

    doing: ClassVar[str]
    """What is said at once: what now happens, and how long it may take."""

    def run(self) -> object: ...


_positional = tyro.conf.configure(tyro.conf.PositionalRequiredArgs)
COMMANDS: dict[str, Callable[..., Command]] = {
    # First what users need first.
    "demo": Demo,
    "doctor": _positional(Doctor),
    "predict": Predict,
    "view": _positional(Viewer),
    "import": _positional(Import),
    "generate": Generate,
    "train": Train,
    "evaluate": Evaluate,
    "board": PrintBoard,
    "export": _positional(Export),
    "pack": Pack,
    "datasheet": DataSheet,
    "validate": Validate,
    "compare": _positional(Compare),
    "failures": _positional(Failures),
    "story": _positional(Story),
    "results": Results,
    "figure": _positional(Figure),
    "bench": SpeedTest,
}


DESCRIPTION = """Surfaces and 6-DoF grasps from a few RGB photos of a table.

Start with demo, doctor, predict and view; import makes scenes of other captures. generate, train and
evaluate are for data, weights and figures of your own."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command: 0, or 1 on the doctor's red, 2 on a mistake of the user, 130 when interrupted, 70 on
    a mistake of ours."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        voice = speak_plainly()
        if words[:1] == ["--version"]:
            print(f"neugrasp {neugrasp.__version__}")
            return 0
        check_command(words, COMMANDS)
        command = tyro.extras.subcommand_cli_from_dict(
            COMMANDS, prog="neugrasp", description=DESCRIPTION, args=words or ["--help"]
        )
        log.info("neugrasp %s: %s", words[0], command.doing)
        report = command.run()
        for part in report if isinstance(report, Iterator) else [report]:
            voice.clear()
            if part is not None:
                print(printable(part), flush=True)
        return report.exit_code if isinstance(report, Verdict) else 0
    except KeyboardInterrupt:
        print("neugrasp: interrupted", file=sys.stderr)
        return 130
    except (NeuGraspError, OSError) as error:
        return _failed(f"{error}")
    except MemoryError:
        return _failed("out of memory")
    except Exception as error:
        # PyTorch has no error of its own for it.
        if "can't allocate memory" in str(error):
            return _failed("out of memory")
        traceback.print_exc()
        return 70


def _failed(reason: str) -> int:
    print(printable(f"neugrasp: error: {reason}", sys.stderr), file=sys.stderr)
    return 2


def _row(name: str, detection: Detection, seconds: float, folder: Path) -> str:
    """Of the table; the seconds are those that a person waits."""
    from neugrasp.detection.explanation import explain

    grasps, waited = detection.grasps, f"{seconds:.1f}"
    if not grasps:
        return ROW.format(name, 0, "-", "-", waited, folder) + "\n  " + explain(detection)
    best = f"{grasps[0].score:.2f}", f"{grasps[0].width * 1000:.0f} mm"
    return ROW.format(name, len(grasps), *best, waited, folder)
