"""`neugrasp import` and `neugrasp board` as plain data; heavy parts load when one is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal


@dataclass(frozen=True, kw_only=True)
class Import:
    """Makes a scene folder from photos and cameras of other programs, whole or not at all
    (docs/capture.md)."""

    doing: ClassVar[str] = "reading photos and cameras"

    format: Literal["nerfstudio", "colmap", "robot", "board"]
    """nerfstudio: transforms.json, also of instant-ngp. colmap: a model, text or binary. robot: robot.json
    with flange poses and hand-eye calibration. board: photos that show a printed board, nothing else."""
    source: Path
    """transforms.json, robot.json, the folder of a COLMAP model, or of photos."""
    out: Path = Path("outputs/scene")
    """The scene folder to write; it must be new."""
    images: Path | None = None
    """The folder of the photos; by default images/ near the source."""
    backgrounds: Path | None = None
    """The folder of photos of the empty table, with the same names; by default backgrounds/ near the
    source."""
    views: tuple[str, ...] = ()
    """Names of the photos to use, 1 to 8; by default all that have a background."""
    board: str | None = None
    """default, or a board's JSON file: the board in the photos says where the cube is, and gives the
    scale."""
    alignment: Path | None = None
    """A JSON file that says so instead: world_from_workspace, metres_per_unit, world_from_reconstruction."""


@dataclass(frozen=True)
class PrintBoard:
    """Writes the board to print and lay on the table, as PDF or PNG in its true size."""

    doing: ClassVar[str] = "drawing the board"

    out: Path = Path("board.pdf")
    """The file to write, .pdf or .png."""
    board: str = "default"
    """default, or a board's JSON file (docs/data_format.md)."""
    paper: Literal["a4", "letter", "a3"] = "a4"
    """Size of the paper, in landscape."""
