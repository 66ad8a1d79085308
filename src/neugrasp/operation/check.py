"""`neugrasp cell check`: what is wrong with a cell, before anything moves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from neugrasp.doctor.findings import Verdict
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, apply, inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.operation.command import Cell
from neugrasp.robot.cell_file import CellFile, read_cell
from neugrasp.robot.errors import NoPlan, Refused
from neugrasp.robot.motion import Motion
from neugrasp.robot.workcell import cameras_of, planner_of, tour_of
from neugrasp.terminal import next_step

SEEN_SHARE = 0.6
"""Share of the corners of what objects fill that a view must show."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    what: str
    problem: str = ""
    """Empty: nothing is wrong."""

    def __str__(self) -> str:
        return f"  wrong  {self.what}: {self.problem}" if self.problem else f"  right  {self.what}"


def run(config: Cell) -> Verdict:
    """`neugrasp cell`: a line for everything that was looked at; 1 where something is wrong."""
    cell = read_cell(config.cell)
    findings = tuple(findings_of(cell))
    wrong = [finding for finding in findings if finding.problem]
    lines = [str(finding) for finding in findings]
    if wrong:
        lines += [f"{config.cell}: {len(wrong)} of {len(findings)} are wrong"]
        lines += [next_step("cell", "check", config.cell, why="when the file is mended")]
    else:
        lines += [f"{config.cell}: nothing is wrong"]
        lines += [next_step("run", config.cell, "--out", "outputs/run")]
    return Verdict("\n".join(lines), 1 if wrong else 0)


def findings_of(cell: CellFile) -> Iterator[Finding]:
    """Everything that can be said of a cell without touching it."""
    motion = planner_of(cell)
    for name, joints in (("out of sight", cell.out_of_sight), ("drop", cell.drop)):
        yield _place(motion, f"place {name!r}", joints)
    yield _beside(cell, motion)
    yield _between(cell, motion)
    cameras = cameras_of(cell)
    for number, camera in enumerate(cameras):
        yield _view(cell.workspace, number, camera)
    yield _tour(cell, motion, cameras)


def _place(motion: Motion, what: str, joints: Array) -> Finding:
    try:
        motion.fence.check_pose(motion.tcp(joints))
    except Refused as error:
        return Finding(what, str(error))
    is_free = motion.checker(None).is_free(joints)
    return Finding(what, "" if is_free else "arm, hand or camera touch something there, or one another")


def _beside(cell: CellFile, motion: Motion) -> Finding:
    """What is dropped must not lie among what is to be picked."""
    what = "drop place beside the workspace"
    place = apply(inverse(cell.workspace.world_from_workspace), motion.tcp(cell.drop)[:3, 3])
    is_over = bool(np.all((place[:2] > 0) & (place[:2] < cell.workspace.size)))
    return Finding(what, "it is over the workspace: what is dropped would be picked again" if is_over else "")


def _between(cell: CellFile, motion: Motion) -> Finding:
    what = "way from the drop place out of sight"
    try:
        way = motion.way(cell.drop, cell.out_of_sight[None], motion.checker(None))
        motion.fence.check(way, cell.drop)
    except (NoPlan, Refused) as error:
        return Finding(what, str(error))
    return Finding(f"{what}, {way.duration:.1f} s")


def _view(workspace: Workspace, number: int, camera: Camera) -> Finding:
    """Whether the camera sees what objects fill."""
    corners = workspace.corners(workspace.table_height, workspace.table_height + workspace.photo_height)
    pixels, depth = camera.project(workspace.to_world(corners))
    left, top, right, bottom = camera.bounds
    u, v = pixels[:, 0], pixels[:, 1]
    inside = (depth > 0) & (u >= left) & (u <= right) & (v >= top) & (v <= bottom)
    share = float(inside.mean())
    problem = "" if share >= SEEN_SHARE else f"shows {inside.sum()} of 8 corners of what objects fill"
    return Finding(f"view {number} shows the workspace", problem)


def _tour(cell: CellFile, motion: Motion, cameras: tuple[Camera, ...]) -> Finding:
    what = f"way through {len(cameras)} views and back"
    try:
        tour = tour_of(cell, motion, cameras)
    except (NoPlan, Refused) as error:
        return Finding(what, str(error))
    seconds = sum(stop.way.duration for stop in tour.stops) + tour.home.duration
    return Finding(f"{what}, {seconds:.1f} s")
