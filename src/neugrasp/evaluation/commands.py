"""The commands of the benchmark as plain data; heavy parts load when one is run."""

from __future__ import annotations

import shlex
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import ClassVar, Literal

from neugrasp.detection.options import DetectorOptions


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Clears tables in simulation and counts: SR, FSR, DR and L1, with intervals. Goes on where it
    stopped."""

    doing: ClassVar[str] = "clearing tables, a minute or so each"

    out: Path
    """Where metrics.json, attempts.jsonl and rounds/ are written."""
    detector: str = "neugrasp"
    """neugrasp, vgn, graspnerf, graspnerf-tsdf, or one of your own by name or as package.module:NAME
    (docs/benchmark.md); oracle and antipodal are told the true surface: measuring sticks, no detectors."""
    scene: Literal["packed", "pile", "single"] = "packed"
    """How the objects lie."""
    materials: Literal["transparent-specular", "diffuse", "mixed", "specular", "transparent"] = (
        "transparent-specular"
    )
    """What the objects are made of."""
    strategy: Literal["protocol", "top", "random", "highest"] = "protocol"
    """Which of the detected grasps is carried out; by default the protocol's."""
    rounds: int | None = None
    """Number of rounds: by default 200, or one for each object where it stands alone."""
    domain: str = "training"
    """training, or lab: another room, a camera that is a little wrong, slippery objects, the 2F-85; or parts
    of it, as lab:lens+hand_eye (docs/benchmark.md)."""
    views: str = "released"
    """Where the cameras stand: released, paper, groups8, ring6, hemisphere6 or training."""
    protocol: str = "paper"
    """paper, vgn or graspnerf: what counts as a success, and out of what (docs/benchmark.md)."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file; by default the detector's own. vgn, and an oracle with VGN's
    head, take a .pth of VGN, too."""
    evaluator: str = "neugrasp"
    """A name of a bundled evaluator of grasps, or a file: what the detectors that have one ask."""
    restorer: str = "swindr"
    """A name of bundled weights that restore depth, or a file: what swindr-vgn asks before VGN."""
    hand_check: bool = True
    """Send grasps as deep as the surface lets the hand, and drop those whose hand would meet it, or close
    on nothing. Never for VGN."""
    threshold: float | None = None
    """Smoothed quality from which a grasp is one; by default the one that the weights were judged with, or
    the protocol's."""
    samples: int = 4
    """Of a pixel of the photos, a power of two, as in `generate`: with one, a round takes less than half the
    time."""
    depth: Literal["exact", "noisy", "stereo"] = "exact"
    """The depth sensor of detectors that see depth; stereo sees glass and steel as such a sensor does."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""
    cell: Path | None = None
    """A cell file: its arm carries the hand, and can fail to reach (docs/robot.md); its gripper and its views
    are those of the rounds."""
    objects: Path | None = None
    """A folder of URDF objects, instead of the built-in ones."""
    split: Literal["test", "train"] = "test"
    """Objects, tables and rooms of the rounds. train: those of training, to choose between weights without
    having looked at the test."""
    seed: int = 0
    """The same seed gives the same rounds and the same metrics, whatever the number of workers."""
    workers: int | None = None
    """Processes that share the rounds; by default one per core."""
    cluster: str | None = None
    """Share the work with a Ray cluster: auto, or its address HOST:6379 (docs/cluster.md)."""
    device: str = "cpu"
    """Where the detector computes: cpu, cuda, cuda:1."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of the detector's products."""

    def options(self) -> DetectorOptions:
        """What the detector is told."""
        return DetectorOptions.of(self)

    @property
    def object_sets(self) -> tuple[str, ...]:
        """The object sets that the scenes are made of."""
        return ("folder",) if self.objects is not None else ("pybullet", "glassware")

    def command(self) -> str:
        """The line that repeats this evaluation; `OUT`, `OBJECTS` and files of weights are for the reader."""
        words = ["neugrasp", "evaluate", "--out", "OUT"]
        for field in fields(self):
            value = getattr(self, field.name)
            is_usual = field.default is MISSING or value == field.default
            if is_usual or field.name in ("out", "workers", "cluster", "device"):
                continue
            if field.name == "objects":
                value = "OBJECTS"
            elif field.name in ("weights", "gripper", "evaluator", "restorer", "cell"):
                value = Path(value).name
            name = field.name.replace("_", "-")
            words += [f"--no-{name}"] if value is False else [f"--{name}", str(value)]
        return shlex.join(words)


@dataclass(frozen=True)
class Compare:
    """Two evaluations of the same rounds, paired: difference, interval and p."""

    doing: ClassVar[str] = "comparing"

    a: Path
    """What `neugrasp evaluate` wrote."""
    b: Path
    """The other one."""


@dataclass(frozen=True)
class Failures:
    """At which objects and materials the grasps of an evaluation failed, and why."""

    doing: ClassVar[str] = "looking at what failed"

    evaluation: Path
    """What `neugrasp evaluate` wrote."""
    objects: Path | None = None
    """The folder of URDF objects that the evaluation was made with."""


@dataclass(frozen=True)
class InspectEpisode:
    """A round of an evaluation as one HTML file: what was seen, what was tried, what came of it."""

    doing: ClassVar[str] = "playing the round again"

    evaluation: Path
    """What `neugrasp evaluate` wrote."""
    round: int
    """Its number, from 0."""
    out: Path | None = None
    """The file; by default reports/ROUND.html in the evaluation."""
    objects: Path | None = None
    """The folder of URDF objects that the evaluation was made with."""
    photos: Literal["auto", "yes", "no"] = "auto"
    """Whether photos are rendered for it (needs Blender); auto: where the detector saw photos."""


@dataclass(frozen=True)
class Table:
    """The paper's table: every system on the same rounds, played or gone on with, the paper's figures beside.

    Both sets of materials, both strategies; differences to neugrasp are paired by round.
    """

    doing: ClassVar[str] = "playing every row; each goes on where it stopped"

    scene: Literal["packed", "pile", "single"]
    """How the objects lie."""
    out: Path = Path("outputs/table")
    """Where SCENE.md and SCENE.json are written, and a folder for each row."""
    rounds: int | None = None
    """Of each row; by default 200, or one for each object where it stands alone. RGBGrasp-GT, which takes a
    minute for every grasp, plays 30 at most."""
    detectors: tuple[str, ...] = ()
    """By name or as package.module:NAME; by default those of the paper's table that have weights."""
    weights: tuple[str, ...] = ()
    """Of detectors that should take others than their own, as NAME=FILE: vgn=vgn_conv.pth, which swindr-vgn
    and rgbgrasp-gt take, too."""
    restorer: str = "swindr"
    """A name of bundled weights that restore depth, or a file: what swindr-vgn asks before VGN."""
    strategies: tuple[Literal["random", "top"], ...] = ("random", "top")
    """Which of the detected grasps is carried out."""
    picture: bool = False
    """Instead of playing, write SCENE_surfaces.png: what each system sees in the first two rounds."""
    samples: int = 1
    """Of a pixel of the photos, a power of two; one plays twice as fast as four."""
    objects: Path | None = None
    """A folder of URDF objects, instead of the built-in ones."""
    seed: int = 0
    """The same seed gives the same rounds."""
    workers: int | None = None
    """Processes that share the rounds; by default one per core."""
    cluster: str | None = None
    """Share the work with a Ray cluster: auto, or its address HOST:6379 (docs/cluster.md)."""
    device: str = "cpu"
    """Where the detectors compute: cpu, cuda, cuda:1."""


@dataclass(frozen=True)
class OneShot:
    """Held-out scenes: how good the surface is, and whether the best grasp holds when it is executed.

    One attempt from each untouched scene, beside the same grasp head on the true surface and random antipodal
    grasps on it. Goes on where it stopped.
    """

    doing: ClassVar[str] = "reading the scenes"

    data: tuple[Path, ...]
    """Folders made by `neugrasp generate`, or of shards packed from them."""
    out: Path
    """Where held_out.json and attempts.jsonl are written."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""
    objects: Path | None = None
    """The folder of URDF objects that the scenes were made of, where they were."""
    threshold: float | None = None
    """Predicted probability of success below which nothing is tried; by default the weights' own."""
    hand_check: bool = True
    """Send grasps as deep as the surface lets the hand, and drop those whose hand would meet it, or close
    on nothing."""
    seed: int = 0
    """Of the random antipodal grasps."""
    device: str = "cpu"
    """Where the network computes: cpu, cuda, cuda:1."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of its products."""
