"""From photos and cameras in another program's format to a scene folder."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from neugrasp.data.camera_checks import check_scene
from neugrasp.data.photo_files import image_size
from neugrasp.data.scene_folder import write_scene
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.errors import InputError, SceneError, told_as
from neugrasp.geometry.pose import inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.importers.alignment import align, read_alignment
from neugrasp.importers.board_file import read_board
from neugrasp.importers.board_photos import posed_by_board, sight, strangers
from neugrasp.importers.colmap import read_model
from neugrasp.importers.command import Import
from neugrasp.importers.mistakes import check_poses, explained
from neugrasp.importers.nerfstudio import check_motion, read_transforms
from neugrasp.importers.photo_folder import PhotoFolder
from neugrasp.importers.photos import Pair, Photos, shortened
from neugrasp.importers.posed_image import Listed, PosedImage, scene_of
from neugrasp.importers.robot_poses import read_robot
from neugrasp.importers.upright import settled
from neugrasp.observation import Views
from neugrasp.terminal import next_step

Format = Literal["nerfstudio", "colmap", "robot", "board"]

logger = logging.getLogger(__name__)


@told_as(SceneError)
def import_scene(run: Import) -> Views:
    """Writes the scene folder, whole or not at all, and returns what is in it. Raises `SceneError`."""
    if run.out.exists() and (not run.out.is_dir() or any(run.out.iterdir())):
        raise InputError(f"{run.out}: exists and is not empty; name a new folder for the scene")
    if not run.source.exists():
        raise InputError(f"{run.source}: missing")
    photos = _photos(run)
    views = _board_scene(run, photos) if run.format == "board" else _posed_scene(run, photos)
    check_scene(views, str(_file(run)))
    with whole_or_nothing(run.out) as part:
        write_scene(part, views)
    return views


def run(config: Import) -> str:
    """`neugrasp import`: how many views the new scene has, and what to do next."""
    views = import_scene(config)
    return f"{len(views)} views in {config.out}\n{next_step('doctor', config.out)}"


def _board_scene(run: Import, photos: Photos) -> Views:
    """A scene whose world is the board's frame and whose cameras are known from the board alone."""
    if run.alignment is not None:
        raise InputError("--alignment: a board says where the cube is by itself; leave one of them away")
    if not run.source.is_dir():
        raise InputError(f"{run.source}: must be a folder with images/ and backgrounds/")
    names = photos.images.names()
    pairs = photos.pairs(names)
    if not photos.chosen:
        photos.tell_of_lost(names)
        if alone := [name for name in names if name not in pairs]:
            logger.warning("%s: have no background; left out", shortened(alone))
    board = settled(read_board(run.board or "default"), pairs)
    return scene_of(posed_by_board(run.source, pairs, board), pairs, board.workspace())


def _posed_scene(run: Import, photos: Photos) -> Views:
    """A scene with poses from somewhere else."""
    if (run.board is None) == (run.alignment is None):
        raise InputError(
            "where is the cube? Give either --alignment FILE (world_from_workspace, and the reconstruction's "
            "scale) or --board default|FILE (a printed board lies in the photos)"
        )
    listed = _listed(run, photos)
    names = [entry.name for entry in listed]
    pairs = photos.pairs(names)
    if twice := next((name for name in pairs if names.count(name) > 1), None):
        raise InputError(f"{_file(run)}: the photo {twice} is there twice; which of its poses is meant?")
    if not photos.chosen:
        photos.tell_of_strangers(names)
        photos.tell_of_lost(names)
    posed_images = [entry.read() for entry in listed if entry.name in pairs]
    if run.board is not None:
        placed, workspace = _on_board(posed_images, pairs, run.board, is_metric=run.format == "robot")
    else:
        placed, workspace = _aligned(run, posed_images)
    check_poses(placed, pairs, workspace, str(_file(run)))
    return scene_of(placed, pairs, workspace)


def _aligned(run: Import, posed_images: list[PosedImage]) -> tuple[list[PosedImage], Workspace]:
    """The posed images and the cube as the alignment's file has them."""
    assert run.alignment is not None
    alignment, workspace = read_alignment(run.alignment)
    if run.format == "nerfstudio":
        check_motion(_file(run), alignment.says_scale, alignment.says_place)
    world, metres = alignment.world_from_reconstruction, alignment.metres_per_unit
    return [posed.placed(world, metres) for posed in posed_images], workspace


def _file(run: Import) -> Path:
    """What holds the poses, or the folder of the photos."""
    name = {"nerfstudio": "transforms.json", "robot": "robot.json"}.get(run.format)
    return run.source / name if name is not None and run.source.is_dir() else run.source


def _listed(run: Import, photos: Photos) -> list[Listed]:
    file = _file(run)
    if run.format == "colmap":
        return read_model(file)
    if run.format == "robot":
        return read_robot(file)

    def size_of(name: str) -> tuple[int, int]:
        photo = photos.image_of(name)
        if photo is None:
            raise InputError(
                f"{file}: 'w' and 'h' are missing, and so is the photo {name} in {photos.images.path}"
            )
        return image_size(photo, name)

    return read_transforms(file, size_of)


def _photos(run: Import) -> Photos:
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
    return Photos(
        PhotoFolder(images),
        PhotoFolder(backgrounds, is_closed=True),
        run.views,
        beside=() if run.images is not None else (folder, images),
        is_relative=run.format == "nerfstudio",
    )


def _on_board(
    posed_images: list[PosedImage], pairs: Mapping[str, Pair], board_name: str, is_metric: bool
) -> tuple[list[PosedImage], Workspace]:
    """A robot's world stays the robot's; that of a reconstruction without units becomes the board's frame."""
    board = settled(read_board(board_name), pairs)
    seen = [
        (posed, sighting)
        for posed in posed_images
        if posed.name in pairs and (sighting := sight(board, pairs[posed.name], posed)) is not None
    ]
    cameras = [inverse(sighting.camera_from_board) for _, sighting in seen]
    try:
        alignment = align([posed.world_from_camera for posed, _ in seen], cameras, has_unit=is_metric)
    except InputError as error:
        text = explained(str(error), [posed for posed, _ in seen], cameras, is_metric)
        raise InputError(text if seen else text + strangers(board, pairs)) from error
    logger.info(
        "the board is in %d photos; 1 unit is %.6g m; the cameras agree within %.1f mm",
        len(seen),
        alignment.metres_per_unit,
        alignment.residual * 1000,
    )
    board_from_world, workspace = alignment.world_from_reconstruction, board.workspace()
    if is_metric:
        place = inverse(board_from_world) @ workspace.world_from_workspace
        return posed_images, Workspace(world_from_workspace=place)
    return [posed.placed(board_from_world, alignment.metres_per_unit) for posed in posed_images], workspace
