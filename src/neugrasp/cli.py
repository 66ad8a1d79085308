"""The `neugrasp` program. The only file that prints; heavy parts load when a command needs them."""

from __future__ import annotations

import sys

try:
    import traceback
    from collections.abc import Callable, Sequence
    from dataclasses import dataclass, field
    from pathlib import Path
    from typing import TYPE_CHECKING, Annotated, Literal, Protocol

    import tyro

    import neugrasp
    from neugrasp.bench.command import SpeedTest
    from neugrasp.data.command import Pack
    from neugrasp.detection.steering import Steering
    from neugrasp.doctor.command import Doctor
    from neugrasp.doctor.findings import Verdict
    from neugrasp.errors import NeuGraspError
    from neugrasp.evaluation.commands import Compare, Evaluate, Failures, Results, Story, Validate
    from neugrasp.exporters.command import Export
    from neugrasp.figures.command import Figure
    from neugrasp.importers.command import Import, PrintBoard
    from neugrasp.report.command import DataSheet
    from neugrasp.terminal import check_command, printable, speak_plainly
    from neugrasp.training.command import Train, TrainEvaluator
    from neugrasp.viewer.command import Viewer
except KeyboardInterrupt:
    # These take the first second of the program: whoever ends it then has made no mistake.
    sys.exit(130)

if TYPE_CHECKING:
    from neugrasp.detection.detector import Detection

ROW = "{:<24} {:>6} {:>6} {:>8} {:>8}  {}"  # Of the demo's table.
Folder = Annotated[Path, tyro.conf.arg(metavar="DIR")]


@dataclass(frozen=True)
class Demo:
    """Bundled scenes in, surfaces, grasps and pictures out. Runs on a CPU right after the installation."""

    out: Folder = Path("outputs/demo")
    """Where NAME/ is written for every scene."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""

    def run(self) -> None:
        from neugrasp.demo import demo_scenes, run_demo
        from neugrasp.detection.detector import NeuGraspDetector

        detector = NeuGraspDetector.load(self.weights, self.gripper)
        print(ROW.format("scene", "grasps", "best", "width", "seconds", "pictures"))
        for scene in demo_scenes():
            folder = self.out / scene.name
            detection = run_demo(scene, detector, folder)
            print(printable(_summary(scene.name, detection, folder)))
        print(
            "\nEvery folder holds overlay.png (the photos with the grasps, the best in green), surface.png\n"
            "(the surface above the true one), slice.png (a cut through the distance grid), grasps.json,\n"
            "surface.ply and tsdf.npz."
        )


@dataclass(frozen=True)
class Predict:
    """Photos of a scene in; grasps.json, surface.ply, tsdf.npz and overlay.png out. The doctor takes a quick
    look first; on red nothing is predicted."""

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
    evaluator: str | None = None
    """Let an evaluator of grasps judge instead of the head and its rules: neugrasp, or a file."""
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
            evaluator=self.evaluator,
            steering=self.steering,
            is_examined=self.examine,
            is_forced=self.force,
        )
        return predict(run)


@dataclass(frozen=True)
class Generate:
    """Simulated scenes with photos, labelled grasps and ground truth. Goes on where it stopped."""

    out: Folder
    """Where the scenes are written."""
    scene: Literal["packed", "pile", "single"] = "packed"
    """How the objects lie."""
    num: int = 100
    """Number of scenes in the folder when done."""
    objects: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """A folder of URDF objects, instead of the built-in ones."""
    materials: Literal["mixed", "diffuse", "specular", "transparent", "transparent-specular"] = "mixed"
    """What the objects are made of."""
    photos: bool = True
    """Without photos scenes come several times faster and serve the grasp head alone."""
    targets: int = 2
    """Photos from the hemisphere for each scene, besides the inputs: what losses compare with."""
    samples: int = 4
    """Of a photo's pixel, a power of two: twice as many take twice the time, a fifth less noise remains."""
    views: str = "training"
    """Where the cameras stand: training, paper, released, ring6 or hemisphere6."""
    split: Literal["train", "test"] = "train"
    """Objects, panoramas and textures of the two never mix."""
    gripper: str = "panda"
    """The gripper that tries the grasps: a name of a bundled one, or a file."""
    seed: int = 0
    """The same seed gives the same scenes, whatever the number of workers."""
    workers: int | None = None
    """Processes that share the work; by default one per core."""

    def run(self) -> None:
        from neugrasp.simulation.generate import GenerateConfig, generate

        folders = generate(
            GenerateConfig(
                out=self.out,
                scene=self.scene,
                num=self.num,
                objects=self.objects,
                materials=self.materials,
                photos=self.photos,
                targets=self.targets,
                samples=self.samples,
                views=self.views,
                split=self.split,
                gripper=self.gripper,
                seed=self.seed,
                workers=self.workers,
            )
        )
        print(printable(f"{len(folders)} scenes in {self.out}"))


class Command(Protocol):
    """Options as fields, and what is done with them; what it returns is printed."""

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
    "train-evaluator": TrainEvaluator,
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
    speak_plainly()
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        if words[:1] == ["--version"]:
            print(f"neugrasp {neugrasp.__version__}")
            return 0
        check_command(words, COMMANDS)
        command = tyro.extras.subcommand_cli_from_dict(
            COMMANDS, prog="neugrasp", description=DESCRIPTION, args=words or ["--help"]
        )
        report = command.run()
        if report is not None:
            print(printable(report))
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


def _summary(name: str, detection: Detection, folder: Path) -> str:
    """A row of the demo's table."""
    from neugrasp.detection.explanation import explain

    grasps, seconds = detection.grasps, f"{sum(detection.timing_s.values()):.1f}"
    if not grasps:
        return ROW.format(name, 0, "-", "-", seconds, folder) + "\n  " + explain(detection)
    best = f"{grasps[0].score:.2f}", f"{grasps[0].width * 1000:.0f} mm"
    return ROW.format(name, len(grasps), *best, seconds, folder)
