"""The example cell, and what is made of it, for tests."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from neugrasp.geometry.pose import Array, rigid, rotation_about
from neugrasp.robot.cell_file import CellFile, read_cell
from neugrasp.robot.interface import ArmState
from neugrasp.robot.trajectory import Trajectory

TWIN = Path(__file__).parents[1] / "examples/cells/twin.toml"
DOWN = np.diag([1.0, -1.0, -1.0])
"""A hand that approaches straight down."""


def example() -> CellFile:
    """examples/cells/twin.toml."""
    return read_cell(TWIN)


def down_at(x: float, y: float, height: float, yaw: float = 0.0) -> Array:
    """`world_from_tcp` of a hand that points down over the table of the example."""
    return rigid(DOWN @ rotation_about((0, 0, 1), yaw), (x, y, height))


@dataclass
class PaperArm:
    """An arm that does at once what it is told, and writes it down."""

    joints: Array
    done: list[Trajectory] = field(default_factory=list)
    stops: int = 0

    def __enter__(self) -> PaperArm:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def state(self) -> ArmState:
        return ArmState(self.joints, np.zeros(6), 0.0)

    def execute(self, motion: Trajectory, until_contact: bool, timeout_s: float) -> bool:
        self.done.append(motion)
        self.joints = motion.joints[-1]
        return False

    def stop(self) -> None:
        self.stops += 1
