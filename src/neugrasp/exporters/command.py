"""`neugrasp export` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal


@dataclass(frozen=True)
class Export:
    """Writes grasps in the convention of another program (drawn in docs/conventions.md), in the world
    frame."""

    doing: ClassVar[str] = "writing the grasps"

    grasps: Path
    """A grasps.json of `neugrasp predict`, or the folder that holds it."""
    format: Literal["graspnet", "vgn", "ros", "ur"] = "ros"
    """graspnet: graspnetAPI's and AnyGrasp's rows of 17 numbers, .npy. vgn: VGN's and GIGA's, .csv.
    ros: PoseStamped dictionaries for MoveIt, .json. ur: p[x, y, z, rx, ry, rz] of Universal Robots, .json."""
    out: Path | None = None
    """The file to write; by default beside GRASPS, named after the format."""
    gripper: str | None = None
    """The gripper that the grasps were predicted for: a name of a bundled one, or a file; by default the one
    that GRASPS names."""
    frame_id: str | None = None
    """For ros: the name of your world in the tree of transforms; by default world."""
    link: Literal["tcp", "hand", "panda_link8"] | None = None
    """For ros and ur: the link whose poses are written: the TCP between the pads (by default), the hand's
    flange, or, for ros, the last link of the Panda's arm, which MoveIt moves."""
