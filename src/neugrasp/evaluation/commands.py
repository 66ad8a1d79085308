"""The commands of the benchmark as plain data; heavy parts load when one is run."""

from __future__ import annotations

import shlex
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import ClassVar, Literal

from neugrasp.detection.options import DetectorOptions


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Clears tables in simulation and reports SR, FSR, DR and L1 with intervals. Continues where it
    stopped."""

    doing: ClassVar[str] = "clearing tables, a minute or so each"

    out: Path
    """Folder for metrics.json, attempts.jsonl and rounds/."""
    detector: str = "neugrasp"
    """neugrasp, vgn, graspnerf, graspnerf-tsdf, or one of your own by name or as package.module:NAME
    (docs/benchmark.md); oracle, antipodal and perfect-judge are told the true surface: measuring sticks, no
    detectors."""
    scene: Literal["packed", "pile", "single"] = "packed"
    """Arrangement of the objects."""
    materials: Literal["transparent-specular", "diffuse", "mixed", "specular", "transparent"] = (
        "transparent-specular"
    )
    """Materials of the objects."""
    strategy: Literal["protocol", "top", "random", "highest"] = "protocol"
    """Which detected grasp is executed; by default as the protocol says."""
    after_failure: Literal["anywhere", "elsewhere"] = "anywhere"
    """Where the next grasp may be after one failed. anywhere: as in the protocols; elsewhere, as in `run`:
    first where none failed, and never where two did."""
    rounds: int | None = None
    """Number of rounds; by default 200, or one for each object where it stands alone."""
    domain: str = "training"
    """training, or lab: another room, a camera that is a little wrong, slippery objects, the 2F-85; or parts
    of it, as lab:lens+hand_eye (docs/benchmark.md)."""
    views: str = "released"
    """Viewpoints of the cameras: released, paper, groups8, ring6, hemisphere6 or training."""
    protocol: str = "paper"
    """paper, vgn or graspnerf: what counts as a success, and out of what (docs/benchmark.md)."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file; by default the detector's own. vgn, and an oracle with VGN's
    head, take a .pth of VGN, too."""
    evaluator: str = "neugrasp"
    """The evaluator of grasps, for detectors that ask one: a bundled name, or a file."""
    restorer: str = "swindr"
    """The weights with which swindr-vgn restores depth: a bundled name, or a file."""
    hand_check: bool = True
    """Push each grasp as deep as the surface allows, and drop grasps that would collide or close on
    nothing. Never for VGN."""
    threshold: float | None = None
    """Minimum score of a grasp; by default the threshold stored with the weights, or the protocol's."""
    samples: int = 4
    """Render samples per pixel, a power of two, as in `generate`; with one, a round takes less than half
    the time."""
    depth: Literal["exact", "noisy", "stereo"] = "exact"
    """The depth sensor of detectors that see depth; stereo sees glass and steel as such a sensor does."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""
    cell: Path | None = None
    """A cell file (docs/robot.md): its arm carries the hand and may fail to reach; the rounds take its
    gripper and its views."""
    objects: Path | None = None
    """A folder of URDF objects, instead of the built-in ones."""
    split: Literal["test", "train"] = "test"
    """Split of objects, tables and rooms. Choose between weights on train, so that test stays unseen."""
    seed: int = 0
    """Random seed; the same seed gives the same rounds and metrics, whatever the number of workers."""
    workers: int | None = None
    """Number of processes that share the rounds; by default one per core."""
    cluster: str | None = None
    """Share the work with a Ray cluster: auto, or its address HOST:6379 (docs/cluster.md)."""
    device: str = "cpu"
    """Device of the detector: cpu, cuda, cuda:1."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Precision of the detector's products."""

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
    """Compares two evaluations of the same rounds, paired: difference, interval and p."""

    doing: ClassVar[str] = "comparing"

    a: Path
    """A folder that `neugrasp evaluate` wrote."""
    b: Path
    """The other one."""


@dataclass(frozen=True)
class Failures:
    """Lists failures of an evaluation by object and material, with reasons."""

    doing: ClassVar[str] = "looking at what failed"

    evaluation: Path
    """A folder that `neugrasp evaluate` wrote."""
    objects: Path | None = None
    """The folder of URDF objects that the evaluation was made with."""


@dataclass(frozen=True)
class InspectEpisode:
    """Writes a round of an evaluation as one HTML file: what was seen, what was tried, what came of it."""

    doing: ClassVar[str] = "playing the round again"

    evaluation: Path
    """A folder that `neugrasp evaluate` wrote."""
    round: int
    """Number of the round, counted from 0."""
    out: Path | None = None
    """The file; by default reports/ROUND.html in the evaluation."""
    objects: Path | None = None
    """The folder of URDF objects that the evaluation was made with."""
    photos: Literal["auto", "yes", "no"] = "auto"
    """Render photos for it (needs Blender); auto: if the detector saw photos."""


@dataclass(frozen=True)
class Table:
    """Plays the paper's table: every system on the same rounds, beside the paper's figures. Continues where
    it stopped.

    Both sets of materials, both strategies; differences to neugrasp are paired by round.
    """

    doing: ClassVar[str] = "playing every row; each goes on where it stopped"

    scene: Literal["packed", "pile", "single"]
    """Arrangement of the objects."""
    out: Path = Path("outputs/table")
    """Folder for SCENE.md, SCENE.json, and a folder for each row."""
    rounds: int | None = None
    """Number of rounds of each row; by default 200, or one for each object where it stands alone.
    RGBGrasp-GT, which takes a minute for every grasp, plays at most 30."""
    detectors: tuple[str, ...] = ()
    """Detectors, by name or as package.module:NAME; by default those of the paper's table that have
    weights."""
    weights: tuple[str, ...] = ()
    """Other weights for detectors, as NAME=FILE: vgn=vgn_conv.pth, which swindr-vgn and rgbgrasp-gt take,
    too."""
    restorer: str = "swindr"
    """The weights with which swindr-vgn restores depth: a bundled name, or a file."""
    strategies: tuple[Literal["random", "top"], ...] = ("random", "top")
    """Which detected grasp is executed."""
    picture: bool = False
    """Instead of playing, write SCENE_surfaces.png: the surfaces that each system sees in the first two
    rounds."""
    samples: int = 1
    """Render samples per pixel, a power of two; one plays twice as fast as four."""
    objects: Path | None = None
    """A folder of URDF objects, instead of the built-in ones."""
    seed: int = 0
    """Random seed; the same seed gives the same rounds."""
    workers: int | None = None
    """Number of processes that share the rounds; by default one per core."""
    cluster: str | None = None
    """Share the work with a Ray cluster: auto, or its address HOST:6379 (docs/cluster.md)."""
    device: str = "cpu"
    """Device of the detectors: cpu, cuda, cuda:1."""


@dataclass(frozen=True)
class OneShot:
    """Judges weights on held-out scenes: their surfaces, and whether the best grasp holds when it is
    executed.

    Makes one attempt in each untouched scene, beside the same grasp head on the true surface and random
    antipodal grasps on it. Continues where it stopped.
    """

    doing: ClassVar[str] = "reading the scenes"

    data: tuple[Path, ...]
    """Folders made by `neugrasp generate`, or of shards packed from them."""
    out: Path
    """Folder for held_out.json and attempts.jsonl."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""
    objects: Path | None = None
    """The folder of URDF objects, if the scenes were generated from one."""
    threshold: float | None = None
    """Minimum score of a grasp; by default the threshold stored with the weights."""
    hand_check: bool = True
    """Push each grasp as deep as the surface allows, and drop grasps that would collide or close on
    nothing."""
    seed: int = 0
    """Seed of the random antipodal grasps."""
    device: str = "cpu"
    """Device of the network: cpu, cuda, cuda:1."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Precision of its products."""
