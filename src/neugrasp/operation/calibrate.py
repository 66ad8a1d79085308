"""`neugrasp calibrate`: hand-eye calibration from photos of a board, with a verdict."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.photo_files import read_image
from neugrasp.data.scene_folder import photo_of
from neugrasp.doctor.findings import Verdict
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, to_quaternion
from neugrasp.importers.board_file import read_board
from neugrasp.importers.files import pose_of
from neugrasp.importers.markers import find_board
from neugrasp.importers.robot_poses import flange_views, lens_of_view
from neugrasp.operation.command import Calibrate
from neugrasp.progress import counted
from neugrasp.robot.hand_eye import HandEye, Sightings, calibrated
from neugrasp.terminal import next_step

log = logging.getLogger(__name__)


def run(config: Calibrate) -> Verdict:
    """`neugrasp calibrate`: the pose for a cell file, how well it fits, and 1 where it is weak."""
    seen, names = sightings_of(config)
    found = calibrated(seen)
    lines = [*_numbers(found, names), "", *_toml(found.flange_from_camera), ""]
    if found.problems:
        lines += ["weak:", *(f"  {problem}" for problem in found.problems)]
        lines += [next_step("calibrate", config.poses, "--board", config.board, why="with better photos")]
    else:
        lines += ["good: put flange_from_camera into the cell file"]
        lines += [next_step("cell", "check", "CELL.toml")]
    return Verdict("\n".join(lines), 1 if found.problems else 0)


def sightings_of(config: Calibrate) -> tuple[Sightings, list[str]]:
    """The poses of the photos in which the board is found, and their names. Raises `InputError`."""
    board = read_board(config.board)
    data, views = flange_views(config.poses)
    listed = [view["image"] for view, _ in views]
    if twice := [name for name in listed if listed.count(name) > 1]:
        raise InputError(f"{config.poses}: the photo {twice[0]} is there twice; which of its poses is meant?")
    focal, flange, camera, names = 0.0, [], [], []
    for view, where in counted(views, "photos"):
        name = view["image"]
        pose = pose_of(view.get("base_from_flange"), f"{where}: base_from_flange")
        lens = lens_of_view(data, view, where)
        focal = focal or float(lens.intrinsics[0, 0])
        photo = read_image(_photo(config.poses.parent, view, where), where)
        if photo.shape[:2] != (lens.height, lens.width):
            height, width = photo.shape[:2]
            raise InputError(
                f"{where}: {width} x {height} pixels; the lens is of {lens.width} x {lens.height}"
            )
        try:
            sighting = find_board(board, photo, lens)
        except InputError as error:
            log.warning("%s: left out: %s", name, error)
            continue
        if sighting is None:
            log.warning("%s: left out: the board is not seen", name)
            continue
        flange.append(pose)
        camera.append(sighting.camera_from_board)
        names.append(name)
    seen = Sightings(
        np.array(flange, dtype=np.float64).reshape(-1, 4, 4),
        np.array(camera, dtype=np.float64).reshape(-1, 4, 4),
        board.print.size,
        focal,
    )
    return seen, names


def _photo(folder: Path, view: dict[str, Any], where: str) -> Path:
    """Beside the poses, or in images/ there. Raises `InputError` on a name that leads elsewhere."""
    beside = photo_of(folder, view, "image", where)
    return beside if beside.is_file() else photo_of(folder / "images", view, "image", where)


def _numbers(found: HandEye, names: Sequence[str]) -> list[str]:
    each = ", ".join(f"{name.capitalize()} {mm:.2f}" for name, mm in found.solvers_mm.items())
    number, pixels = found.worst
    return [
        f"{len(names)} photos; the board's origin spreads by {found.spread_mm:.2f} mm (closed forms: {each})",
        f"the board is {found.error_px:.2f} pixels off, at most {pixels:.2f} in {names[number]}",
        f"one standard deviation: {found.doubt_mm:.2f} mm, {found.doubt_deg:.3f} degrees",
    ]


def _toml(pose: Array) -> list[str]:
    """As a cell file has it."""
    position, quaternion = (
        ", ".join(f"{x:.6f}" for x in numbers) for numbers in (pose[:3, 3], to_quaternion(pose))
    )
    return [f"flange_from_camera = {{ position = [{position}], quaternion_xyzw = [{quaternion}] }}"]
