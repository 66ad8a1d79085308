"""Cameras known from a printed board in their photos."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from neugrasp.data.photo_files import read_image
from neugrasp.data.strict_json import read_object
from neugrasp.errors import InputError
from neugrasp.geometry.lens import Lens
from neugrasp.geometry.pose import Array, apply, inverse
from neugrasp.importers.board import Board
from neugrasp.importers.markers import Sighting, calibrate, find_board, other_markers
from neugrasp.importers.photo_folder import PhotoFolder
from neugrasp.importers.photos import Pair
from neugrasp.importers.posed_image import PosedImage
from neugrasp.importers.robot_poses import camera_of
from neugrasp.progress import counted

STILL = 1.0
"""Pixels by which the board's corners may move between image and background of a camera that stood still."""

logger = logging.getLogger(__name__)


def posed_by_board(folder: Path, pairs: Mapping[str, Pair], board: Board) -> list[PosedImage]:
    """The camera of every pair in the board's frame. Raises `InputError` where a photo shows no board."""
    lens = _lens(folder, pairs, board)
    return [_shot(name, pair, lens, board) for name, pair in counted(pairs.items(), "photos")]


def strangers(board: Board, pairs: Mapping[str, Pair]) -> str:
    """What else is printed in the first of the backgrounds; empty where nothing of the kind is."""
    file = next(iter(pairs.values())).background
    seen = other_markers(board, read_image(file, "the board"))
    return f". {file}: {seen}" if seen else ""


def sight(board: Board, pair: Pair, posed: PosedImage) -> Sighting | None:
    """The board as the camera of the image sees it: in the background, where nothing covers it and the camera
    stood still, or in the image."""
    if posed.world_from_background is None:
        in_background = _in_photo(board, pair.background, posed.lens)
        if in_background is not None:
            return in_background
    return _in_photo(board, pair.image, posed.lens)


def _shot(name: str, pair: Pair, lens: Lens, board: Board) -> PosedImage:
    background, image = (_in_photo(board, file, lens) for file in (pair.background, pair.image))
    if background is None:
        text = f"{pair.background}: the board is not found; it must lie flat, whole and sharp in the photo"
        raise InputError(text + strangers(board, {name: pair}))
    logger.info("%s: %d corners within %.2f pixels", name, background.num_points, background.error)
    world_from_background = inverse(background.camera_from_board)
    if image is None:
        logger.warning("%s: the board is not found; the camera is taken to have stood still", pair.image)
    if image is None or _motion(board, lens, image, background) < STILL:
        return PosedImage(name, lens, world_from_background)
    return PosedImage(name, lens, inverse(image.camera_from_board), world_from_background)


def _motion(board: Board, lens: Lens, one: Sighting, other: Sighting) -> float:
    """Pixels by which the corners of the print move from one camera to the other, at most."""
    width, height = board.print.size
    corners = np.array([(0, 0, 0), (width, 0, 0), (width, height, 0), (0, height, 0)])
    pixels = [_projected(lens, apply(sighting.camera_from_board, corners)) for sighting in (one, other)]
    return float(np.linalg.norm(pixels[0] - pixels[1], axis=-1).max())


def _projected(lens: Lens, points: Array) -> Array:
    return np.asarray((points / points[:, 2:]) @ lens.intrinsics.T)[:, :2]


def _in_photo(board: Board, file: Path, lens: Lens) -> Sighting | None:
    photo = read_image(file, "the board")
    if photo.shape[:2] != (lens.height, lens.width):
        raise InputError(
            f"{file}: {photo.shape[1]} x {photo.shape[0]} pixels; its camera was calibrated for "
            f"{lens.width} x {lens.height}"
        )
    try:
        return find_board(board, photo, lens)
    except InputError as error:
        raise InputError(f"{file}: {error}") from error


def _lens(folder: Path, pairs: Mapping[str, Pair], board: Board) -> Lens:
    """`camera.json` of the folder, or a calibration from the photos in `calibration` and the backgrounds."""
    file = folder / "camera.json"
    if file.exists():
        return camera_of(read_object(file, "a calibration of the camera"), file)
    files = [*PhotoFolder(folder / "calibration").photos, *(pair.background for pair in pairs.values())]
    try:
        lens = calibrate(board, [read_image(file, "the calibration") for file in files])
    except InputError as error:
        raise InputError(f"{folder}: {error}") from error
    fx, fy, k1 = lens.intrinsics[0, 0], lens.intrinsics[1, 1], lens.radial[0]
    logger.info("calibrated with %d photos: fx %.1f, fy %.1f pixels, k1 %.3f", len(files), fx, fy, k1)
    return lens
