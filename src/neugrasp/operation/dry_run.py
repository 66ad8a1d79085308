"""`neugrasp run --dry-run`: every motion that a round would make, printed and drawn. Nothing is connected."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from neugrasp.data.scene_folder import read_scene
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.detection.contract import Detector
from neugrasp.errors import InputError
from neugrasp.evaluation.protocols import Choose
from neugrasp.geometry.pose import inverse
from neugrasp.observation import Views
from neugrasp.operation.path_picture import path_picture
from neugrasp.operation.steps import listed, plain
from neugrasp.pictures import write_picture
from neugrasp.robot.cell_file import CellFile
from neugrasp.robot.rehearsal import Rehearsal, rehearsed
from neugrasp.robot.workcell import cameras_of, planner_of, tour_of

FOLDER, MOTIONS, PICTURE = "dry_run", "motions.json", "motions.png"
APART = 1e-3
"""Metres, and entries of a rotation, by which the cube of photos may be away from that of the cell."""


def rehearsed_with_photos(
    cell: CellFile, photos: Path | None, detector: Detector[Views], choose: Choose
) -> Rehearsal:
    """With photos that `neugrasp capture` took. Raises `InputError` where there are none of this cell."""
    if photos is None:
        raise InputError(
            f"--dry-run sends nothing to the arm, so it needs photos: neugrasp capture {cell.source} "
            "--out scene, then --photos scene"
        )
    seen = read_scene(photos)
    apart = np.abs(seen.workspace.world_from_workspace - cell.workspace.world_from_workspace).max()
    if apart > APART:
        raise InputError(f"{photos}: its cube is not where {cell.source} has it; take the photos again")
    motion = planner_of(cell)
    tour = tour_of(cell, motion, cameras_of(cell))
    rng, up = np.random.default_rng([0, 0]), cell.workspace.world_from_workspace[:3, 2]
    return rehearsed(cell, motion, tour, detector.detect(seen), lambda grasps: choose(grasps, rng, up))


def written(rehearsal: Rehearsal, cell: CellFile, out: Path) -> str:
    """What is printed; motions.json and motions.png in `out`/dry_run, too. `cell` as its file has it."""
    planner = planner_of(cell)
    with whole_or_nothing(out / FOLDER, (MOTIONS, PICTURE)) as part:
        steps = [plain(step, planner) for step in rehearsal.steps]
        (part / MOTIONS).write_text(json.dumps(steps) + "\n", encoding="utf-8")
        write_picture(part / PICTURE, path_picture(rehearsal, cell.workspace, planner))
    passed = [f"passed over: {one.reason} ({one.details})" for one in rehearsal.skipped]
    count = len(rehearsal.detection.grasps)
    if rehearsal.grasp is None:
        chosen = f"{count} grasps detected, none of which can be carried out"
    else:
        local = inverse(rehearsal.detection.workspace.world_from_workspace)
        grasp = rehearsal.grasp.moved(cell.workspace.world_from_workspace @ local)
        chosen = f"{count} grasps detected; chosen: {grasp!r}"
    seconds = sum(step.motion.duration for step in rehearsal.steps if step.motion is not None)
    return "\n".join(
        [
            *listed(rehearsal.steps, planner),
            *passed,
            chosen,
            f"{len(rehearsal.steps)} steps, {seconds:.1f} s of motion; nothing was sent to arm or gripper",
            str(out / FOLDER / PICTURE),
        ]
    )
