"""The commands for a cell as plain data; heavy parts load when one is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from neugrasp.detection.options import DetectorOptions


@dataclass(frozen=True)
class Run:
    """Clears the table of a cell: look, detect, choose, plan, pick, drop, until it is empty. Continues
    where it stopped."""

    doing: ClassVar[str] = "reading the cell and planning the ways to its views"

    cell: Path
    """The cell file (docs/robot.md); examples/cells/twin.toml is a simulated one."""
    out: Path = Path("outputs/run")
    """Folder for run.json and rounds/, like those of `neugrasp evaluate`: `inspect-episode`, `view` and
    `failures` read them."""
    detector: str = "auto"
    """A detector as in `neugrasp predict`; oracle knows the true surface of a simulated table, and needs
    no photos."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    evaluator: str = "neugrasp"
    """The evaluator of grasps, for detectors that ask one: a bundled name, or a file."""
    hand_check: bool = True
    """Push each grasp as deep as the surface allows, and drop grasps that would collide or close on
    nothing."""
    threshold: float | None = None
    """Minimum score of a grasp; by default the detector's own."""
    strategy: Literal["top", "random", "highest"] = "top"
    """Order in which detected grasps are tried until one can be reached."""
    max_failures: int = 3
    """Number of failures in a row after which the arm stops."""
    speed: float = 1.0
    """Speed of the arm as a share of the cell's limits, above 0 and up to 1."""
    dry_run: bool = False
    """Print and draw every motion of the first round, and send nothing to arm or gripper."""
    photos: Path | None = None
    """With --dry-run on hardware: the scene that `neugrasp capture` wrote."""
    confirm: bool = False
    """Before every motion, say what comes and wait for Enter; s leaves the grasp out, q ends the run."""
    view: bool = False
    """Show the run in the browser while it lasts, with a button that stops the arm."""
    host: str = "127.0.0.1"
    """Address of the page of --view; 0.0.0.0 lets other machines look and stop, too."""
    port: int | None = None
    """Port of the page of --view; by default the first free one from 8080 on."""
    samples: int = 4
    """Render samples per pixel in simulation, a power of two."""
    device: str = "cpu"
    """Device of the detector: cpu, cuda, cuda:1."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Precision of the detector's products."""

    def options(self) -> DetectorOptions:
        """What the detector is told."""
        return DetectorOptions.of(self)


@dataclass(frozen=True)
class Capture:
    """Takes the photos of a cell and writes a scene folder, for `predict` or for those who plan elsewhere."""

    doing: ClassVar[str] = "reading the cell and planning the ways to its views"

    cell: Path
    """The cell file (docs/robot.md)."""
    out: Path = Path("outputs/captured")
    """The scene folder; it must be new."""
    empty: bool = False
    """Photograph the empty table, once; the photos are kept beside the cell file, in NAME_empty/."""
    speed: float = 1.0
    """Speed of the arm as a share of the cell's limits, above 0 and up to 1."""
    samples: int = 4
    """Render samples per pixel in simulation, a power of two."""


@dataclass(frozen=True)
class Calibrate:
    """Finds where the camera sits on the flange, from photos of a printed board and the poses of the
    flange."""

    doing: ClassVar[str] = "looking for the board in the photos"

    poses: Path
    """robot.json: the lens, and a view with image and base_from_flange for every photo (docs/robot.md)."""
    board: str = "default"
    """default (`neugrasp board` prints it), or a board's JSON file (docs/data_format.md)."""


@dataclass(frozen=True)
class Cell:
    """Says what is wrong with a cell file before anything moves."""

    doing: ClassVar[str] = "examining the cell"

    action: Literal["check"]
    """check: test its places, its views, and the ways between them."""
    cell: Path
    """The cell file (docs/robot.md)."""


@dataclass(frozen=True, kw_only=True)
class Collect:
    """Makes a set for `train --recipe adapt`: photos of a cell, and the outcomes of grasps there.
    Continues where it stopped."""

    doing: ClassVar[str] = "laying scenes, looking at them and trying grasps"

    out: Path
    """The data folder: scenes/ with photos and tried grasps, without depth or truth."""
    scenes: int = 40
    """Number of scenes in the folder when done."""
    grasps: int = 20
    """Maximum number of grasps tried in a scene: the model's picks, and others where these are fewer."""
    domain: str = "lab"
    """Domain in which a floating hand tries them, as in `evaluate`."""
    cell: Path | None = None
    """A cell file: its arm tries the grasps instead; a real table loses what was picked, and each pick is a
    scene."""
    by_hand: bool = False
    """Let a person lead a real arm to the grasps; Enter closes the gripper."""
    speed: float = 1.0
    """Speed of the arm as a share of the cell's limits, above 0 and up to 1."""
    scene: Literal["both", "packed", "pile"] = "both"
    """Arrangement of simulated objects; both: by turns."""
    materials: Literal["mixed", "transparent-specular", "diffuse", "specular", "transparent"] = "mixed"
    """Materials of the objects."""
    detector: str = "neugrasp"
    """Detector whose picks are tried, as in `neugrasp evaluate`."""
    weights: str = "neugrasp"
    """Its weights: a name of bundled ones, or a file."""
    hand_check: bool = True
    """Leave out grasps whose hand would meet the reconstructed surface, or close on nothing: what they would
    have told is not known then."""
    threshold: float = 0.3
    """Minimum score of the grasps tried; lower than for clearing a table, because failures teach, too."""
    samples: int = 4
    """Render samples per pixel in simulation, a power of two."""
    seed: int = 0
    """Random seed; the same seed gives the same scenes and grasps."""
    device: str = "cpu"
    """Device of the detector: cpu, cuda, cuda:1."""
