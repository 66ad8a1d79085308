"""From photos and cameras in another program's format to a scene folder."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from PIL import Image as Picture

from neugrasp.data.camera_checks import check_scene
from neugrasp.data.scene_folder import write_scene
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.errors import InputError
from neugrasp.geometry.pose import inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.importers.alignment import align, read_alignment
from neugrasp.importers.board import read_board
from neugrasp.importers.board_photos import board_shots, sight
from neugrasp.importers.colmap import read_model
from neugrasp.importers.nerfstudio import read_transforms
from neugrasp.importers.photos import Pair, Photos, find, photo_names, shortened, stem_of
from neugrasp.importers.robot_poses import read_robot
from neugrasp.importers.shots import Shot, scene_of
from neugrasp.views import Views

Format = Literal["nerfstudio", "colmap", "robot", "board"]

logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class ImportRun:
    """What is imported, and how."""

    format: Format
    source: Path
    """transforms.json, robot.json, or a folder with one of them, with a COLMAP model or with photos."""
    out: Path
    """The new scene folder."""
    images: Path | None = None
    """The photos; by default `images` near the source, or its folder."""
    backgrounds: Path | None = None
    """Those of the empty table; by default `backgrounds` near the source."""
    chosen: tuple[str, ...] = ()
    """Names of the photos to use; all that have a background by default."""
    board: str | None = None
    """`default` or a board's file: the board is in the photos and says where the cube is."""
    alignment: Path | None = None
    """A file that says so instead."""


def import_scene(run: ImportRun) -> Views:
    """Writes the scene folder, whole or not at all, and returns what is in it. Raises `InputError`."""
    if run.out.exists() and (not run.out.is_dir() or any(run.out.iterdir())):
        raise InputError(f"{run.out}: exists and is not empty; name a new folder for the scene")
    if not run.source.exists():
        raise InputError(f"{run.source}: missing")
    photos = _photos(run)
    views = _board_scene(run, photos) if run.format == "board" else _posed_scene(run, photos)
    check_scene(views, str(run.source))
    with whole_or_nothing(run.out) as part:
        write_scene(part, views)
    return views


def _board_scene(run: ImportRun, photos: Photos) -> Views:
    """A scene whose world is the board's frame and whose cameras are known from the board alone."""
    if run.alignment is not None:
        raise InputError("--alignment: a board says where the cube is by itself; leave one of them away")
    if not run.source.is_dir():
        raise InputError(f"{run.source}: must be a folder with images/ and backgrounds/")
    board = read_board(run.board or "default")
    pairs = photos.pairs(photo_names(photos.images))
    return scene_of(board_shots(run.source, pairs, board), pairs, board.workspace())


def _posed_scene(run: ImportRun, photos: Photos) -> Views:
    """A scene with poses from somewhere else."""
    if (run.board is None) == (run.alignment is None):
        raise InputError(
            "where is the cube? Give either --alignment FILE (world_from_workspace, and the reconstruction's "
            "scale) or --board default|FILE (a printed board lies in the photos)"
        )
    shots = _shots(run, photos)
    names = [shot.name for shot in shots]
    pairs = photos.pairs(names)
    _tell_of_strangers(photos, names)
    if run.board is not None:
        placed, workspace = _on_board(shots, pairs, run.board, is_metric=run.format == "robot")
        return scene_of(placed, pairs, workspace)
    assert run.alignment is not None
    alignment, workspace = read_alignment(run.alignment)
    world, metres = alignment.world_from_reconstruction, alignment.metres_per_unit
    return scene_of([shot.placed(world, metres) for shot in shots], pairs, workspace)


def _shots(run: ImportRun, photos: Photos) -> list[Shot]:
    if run.format == "colmap":
        return read_model(run.source)
    name = {"nerfstudio": "transforms.json", "robot": "robot.json"}[run.format]
    file = run.source / name if run.source.is_dir() else run.source
    if run.format == "robot":
        return read_robot(file)

    def size_of(name: str) -> tuple[int, int]:
        photo = find(photos.images, name)
        if photo is None:
            raise InputError(
                f"{file}: 'w' and 'h' are missing, and so is the photo {name} in {photos.images}"
            )
        with Picture.open(photo) as picture:
            return picture.size

    return read_transforms(file, size_of)


def _photos(run: ImportRun) -> Photos:
    """Where images and backgrounds lie, given or guessed."""
    folder = (run.source if run.source.is_dir() else run.source.parent).absolute()
    # A COLMAP model lies in sparse/0, beside the photos' folder or two levels below it.
    near = [folder, folder.parent, folder.parent.parent] if run.format == "colmap" else [folder]
    images = run.images or next((place / "images" for place in near if (place / "images").is_dir()), folder)
    near.append(images.absolute().parent)
    guess = next((place / "backgrounds" for place in near if (place / "backgrounds").is_dir()), None)
    backgrounds = run.backgrounds or guess
    if backgrounds is None or not backgrounds.is_dir():
        raise InputError(
            f"{backgrounds or folder / 'backgrounds'}: no such folder; every photo needs one of the empty "
            "table from the same place and of the same name: --backgrounds DIR"
        )
    if not images.is_dir():
        raise InputError(f"{images}: no such folder; --images names the one with the photos")
    return Photos(images, backgrounds, run.chosen)


def _tell_of_strangers(photos: Photos, names: list[str]) -> None:
    """Warns of backgrounds whose photo has no pose: a reconstruction may have left it out."""
    known = {stem_of(name) for name in names}
    strangers = [name for name in photo_names(photos.backgrounds) if stem_of(name) not in known]
    if strangers:
        logger.warning("%s: no pose is known for %s; left out", photos.backgrounds, shortened(strangers))


def _on_board(
    shots: list[Shot], pairs: Mapping[str, Pair], board_name: str, is_metric: bool
) -> tuple[list[Shot], Workspace]:
    """A robot's world stays the robot's; that of a reconstruction without units becomes the board's frame."""
    board = read_board(board_name)
    seen = [
        (shot, sighting)
        for shot in shots
        if shot.name in pairs and (sighting := sight(board, pairs[shot.name], shot)) is not None
    ]
    alignment = align(
        [shot.world_from_camera for shot, _ in seen],
        [inverse(sighting.camera_from_board) for _, sighting in seen],
        has_unit=is_metric,
    )
    logger.info(
        "the board is in %d photos; 1 unit is %.6g m; the cameras agree within %.1f mm",
        len(seen),
        alignment.metres_per_unit,
        alignment.residual * 1000,
    )
    board_from_world, workspace = alignment.world_from_reconstruction, board.workspace()
    if is_metric:
        place = inverse(board_from_world) @ workspace.world_from_workspace
        return shots, Workspace(world_from_workspace=place)
    return [shot.placed(board_from_world, alignment.metres_per_unit) for shot in shots], workspace
