"""A cell ready to be planned in: its file, its fence, its planner, and the ways to the views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, inverse, rigid
from neugrasp.geometry.surface import Surface
from neugrasp.geometry.view_sets import view_set
from neugrasp.geometry.workspace import Workspace
from neugrasp.robot.cell_file import CellFile
from neugrasp.robot.errors import NoPlan, Refused, Unreachable
from neugrasp.robot.limits import Fence
from neugrasp.robot.motion import OUT_OF_SIGHT, Motion
from neugrasp.robot.tool import Tool
from neugrasp.robot.tour import Stop, Tour

CUBE_FACES = (
    (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
    (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
)  # fmt: skip
"""Triangles between the corners of a workspace."""


def planner_of(cell: CellFile) -> Motion:
    """The planner of a cell, and the fence around its arm."""
    workspace = cell.workspace
    table = workspace.world_from_workspace @ rigid(translation=workspace.centre)
    hand = cell.gripper
    fence = Fence(cell.limits, cell.arm.model, cell.arm.world_from_base, hand.flange_from_tcp, table)
    # The fingers of a simulated hand slide straight.
    gripper = replace(hand.gripper, finger_arc=None) if cell.is_twin else hand.gripper
    tool = Tool.of(gripper, hand.flange_from_hand, [cell.camera.housing])
    return Motion(fence, tool, cell.approach_speed)


def moved_to(cell: CellFile, workspace: Workspace) -> CellFile:
    """The same cell in a world in which its cube lies where `workspace` does: a simulation's."""
    new_from_old = workspace.world_from_workspace @ inverse(cell.workspace.world_from_workspace)
    if not np.allclose(new_from_old[:3, :3], np.eye(3), atol=1e-9):
        raise Unreachable("the cube is turned against the world; zone and keep-out boxes cannot follow")
    shift = new_from_old[:3, 3]
    limits = replace(
        cell.limits,
        zone=cell.limits.zone.moved(shift),
        keep_out=tuple(box.moved(shift) for box in cell.limits.keep_out),
    )
    arm = replace(cell.arm, world_from_base=new_from_old @ cell.arm.world_from_base)
    return replace(cell, arm=arm, workspace=workspace, limits=limits)


def cameras_of(cell: CellFile, seed: int = 0) -> tuple[Camera, ...]:
    """Where the views of a cell are taken from, in its world."""
    named = view_set(cell.views, cell.workspace, np.random.default_rng(seed))
    seen = cell.camera.camera
    moved = [camera.moved(cell.workspace.world_from_workspace) for camera in named]
    return tuple(replace(seen, world_from_camera=camera.world_from_camera) for camera in moved)


def tour_of(cell: CellFile, motion: Motion, cameras: Sequence[Camera]) -> Tour:
    """The ways from out of sight through all views and back, past the cube: nobody knows what lies in it.

    Raises a `NoPlan` or a `Refused` that names the view.
    """
    checker = motion.checker(_cube(cell.workspace))
    here, stops = cell.out_of_sight, []
    for number, camera in enumerate(cameras):
        try:
            goals = motion.solutions(_tcp_of(cell, camera), here)
            way = motion.way(here, goals, checker)
            motion.fence.check(way, here)
        except (NoPlan, Refused) as error:
            raise type(error)(f"view {number}: {error}") from error
        stops.append(Stop(camera, way.named(f"to view {number}")))
        here = way.joints[-1]
    home = motion.way(here, cell.out_of_sight[None], checker)
    motion.fence.check(home, here)
    return Tour(tuple(stops), home.named(OUT_OF_SIGHT))


def _tcp_of(cell: CellFile, camera: Camera) -> Array:
    """Where the TCP is when the camera is there."""
    pose: Array = (
        camera.world_from_camera @ inverse(cell.camera.flange_from_camera) @ cell.gripper.flange_from_tcp
    )
    return pose


def _cube(workspace: Workspace) -> Surface:
    """The part of the cube in which objects may stand, as an obstacle."""
    corners = workspace.corners(workspace.table_height, workspace.table_height + workspace.photo_height)
    return Surface(workspace.to_world(corners), np.array(CUBE_FACES, dtype=np.int32))
