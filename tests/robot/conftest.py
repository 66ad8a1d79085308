"""The example cell in a world of physics with a table at its place."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.robot.cell_file import CellFile
from neugrasp.robot.motion import Motion
from neugrasp.robot.workcell import moved_to, planner_of
from neugrasp.simulation.physics import World
from robot_cells import example
from toy_boxes import Boxes


@pytest.fixture(scope="module")
def cell() -> CellFile:
    return moved_to(example(), Workspace())


@pytest.fixture(scope="module")
def motion(cell: CellFile) -> Motion:
    return planner_of(cell)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    with World(Workspace(), Boxes(tmp_path_factory.mktemp("boxes")), Gripper.load("robotiq_2f85")) as world:
        yield world
