"""Finds a printed board in photos, calibrates a lens by it, and draws it. The only file that uses OpenCV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from neugrasp.errors import InputError, require
from neugrasp.geometry.pose import Array, rigid
from neugrasp.importers.board import Board, Charuco, Tag, Tags
from neugrasp.importers.lens import Lens
from neugrasp.views import Image

FEWEST_POINTS = 6
"""Corners of a chessboard that fix a pose well; one tag has four."""


@dataclass(frozen=True)
class Sighting:
    """A board in a photo."""

    camera_from_board: Array
    """4x4, metres, OpenCV axes."""
    error: float
    """Root mean square distance of the corners from where the pose puts them, pixels."""
    num_points: int


def find_board(board: Board, photo: Image, lens: Lens) -> Sighting | None:
    """The pose of the board in a photo as the lens took it, with distortion; None where it is not seen."""
    cv2 = require("cv2", extra="capture")
    found = _corners(cv2, board, photo)
    if found is None:
        return None
    points, pixels = found
    _, rotations, translations, _ = cv2.solvePnPGeneric(
        points, pixels, lens.intrinsics, lens.coefficients, flags=cv2.SOLVEPNP_IPPE
    )
    best: Sighting | None = None
    # A plane seen from afar can be explained in two ways; both are refined, and the better one is kept.
    for first, second in zip(rotations, translations, strict=True):
        turn, shift = cv2.solvePnPRefineLM(points, pixels, lens.intrinsics, lens.coefficients, first, second)
        expected, _ = cv2.projectPoints(points, turn, shift, lens.intrinsics, lens.coefficients)
        error = float(np.sqrt(((expected.reshape(-1, 2) - pixels) ** 2).sum(axis=1).mean()))
        if best is None or error < best.error:
            best = Sighting(rigid(cv2.Rodrigues(turn)[0], shift.ravel()), error, len(points))
    return best


def calibrate(board: Board, photos: Sequence[Image]) -> Lens:
    """The lens that took photos of a board from different directions; all of one size.

    Raises `InputError` where fewer than three of them show the board, or where the result is no camera.
    """
    cv2 = require("cv2", extra="capture")
    height, width = photos[0].shape[:2]
    if any(photo.shape[:2] != (height, width) for photo in photos):
        raise InputError("the photos for the calibration differ in size")
    found = [corners for photo in photos if (corners := _corners(cv2, board, photo)) is not None]
    if len(found) < 3:
        raise InputError(
            f"the board was found in {len(found)} of {len(photos)} photos; a calibration needs it in 3, "
            "better in 10, from different sides and tilts (or give camera.json)"
        )
    # OpenCV calibrates from float32 only.
    points, pixels = ([values.astype(np.float32) for values in part] for part in zip(*found, strict=True))
    # One coefficient of distortion: more of them fit the board and go astray where it never was.
    flags = cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    error, matrix, bend, _, _ = cv2.calibrateCamera(points, pixels, (width, height), None, None, flags=flags)
    if error > 2.0:
        raise InputError(
            f"the calibration is off by {error:.1f} pixels: is the board flat and of the given size?"
        )
    return Lens(np.asarray(matrix, dtype=np.float64), width, height, (float(bend.ravel()[0]), 0.0, 0.0))


def picture_of(board: Board, dots_per_metre: float) -> Image:
    """The print alone, without a margin; the upper edge of the picture is the far edge of the board."""
    cv2 = require("cv2", extra="capture")
    width, height = (round(side * dots_per_metre) for side in board.print.size)
    if isinstance(board.print, Charuco):
        grey = _charuco(cv2, board.print).generateImage((width, height), marginSize=0, borderBits=1)
    else:
        grey = _tags_picture(cv2, board.print, width, height, dots_per_metre)
    return np.repeat(np.asarray(grey, dtype=np.uint8)[..., None], 3, axis=-1)


def _tags_picture(cv2: ModuleType, tags: Tags, width: int, height: int, dots_per_metre: float) -> np.ndarray:
    """Every tag drawn upright and large, then warped to its place."""
    sheet = np.full((height, width), 255, dtype=np.uint8)
    dictionary = _dictionary(cv2, tags.dictionary)
    side = 40 * (dictionary.markerSize + 2)
    upright = np.array([(0, 0), (side, 0), (side, side), (0, side)], dtype=np.float32) - 0.5
    for tag in tags.tags:
        _check_printable(dictionary, tags, tag)
        marker = cv2.aruco.generateImageMarker(dictionary, tag.number, side, borderBits=1)
        place = tag.corners[:, :2] * [1, -1] * dots_per_metre + [0, height] - 0.5
        warp = cv2.getPerspectiveTransform(upright, place.astype(np.float32))
        smooth = cv2.warpPerspective(marker, warp, (width, height), flags=cv2.INTER_AREA, borderValue=255)
        sheet = np.minimum(sheet, smooth)
    return sheet


def _check_printable(dictionary: Any, tags: Tags, tag: Tag) -> None:
    count = len(dictionary.bytesList)
    if not 0 <= tag.number < count:
        raise InputError(f"tag {tag.number}: {tags.dictionary} has tags 0 to {count - 1}")
    if tag.corners[:, :2].min() < -1e-9:
        raise InputError(
            f"tag {tag.number}: reaches past the lower left corner of the board, which is its origin"
        )


def _corners(cv2: ModuleType, board: Board, photo: Image) -> tuple[Array, Array] | None:
    """Points (n, 3) of the board and their pixels (n, 2), None where there are too few."""
    picture = cv2.cvtColor(np.ascontiguousarray(photo), cv2.COLOR_RGB2GRAY)
    if isinstance(board.print, Tags):
        return _tag_corners(cv2, board.print, picture)
    chessboard = _charuco(cv2, board.print)
    pixels, numbers, _, _ = cv2.aruco.CharucoDetector(chessboard).detectBoard(picture)
    if numbers is None or len(numbers) < FEWEST_POINTS:
        return None
    points = chessboard.getChessboardCorners()[numbers.ravel()]
    # OpenCV counts y down the sheet, from its upper edge, with z into the paper.
    points = np.stack([points[:, 0], board.print.size[1] - points[:, 1], 0 * points[:, 0]], axis=-1)
    return points.astype(np.float64), _refined(cv2, board.print, points, pixels.reshape(-1, 2), picture)


def _refined(
    cv2: ModuleType, charuco: Charuco, points: Array, pixels: np.ndarray, picture: np.ndarray
) -> Array:
    """Corners of the chessboard with pixel centres at integers.

    The detector of OpenCV 4 counts from the corner of the first pixel, that of OpenCV 5 from its centre;
    seeking every corner again from there gives the same for both.
    """
    size = charuco.square * np.sqrt(np.cov(pixels.T).trace() / np.cov(points[:, :2].T).trace())
    white = (charuco.square - charuco.marker) / (2 * charuco.square)
    half = int(np.clip(size * white - 1, 2, 9))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 0.005)
    found = cv2.cornerSubPix(picture, pixels[:, None].astype(np.float32), (half, half), (-1, -1), stop)
    return np.asarray(found.reshape(-1, 2), dtype=np.float64)


def _tag_corners(cv2: ModuleType, tags: Tags, picture: np.ndarray) -> tuple[Array, Array] | None:
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(_dictionary(cv2, tags.dictionary), settings)
    corners, numbers, _ = detector.detectMarkers(picture)
    seen = {} if numbers is None else dict(zip(numbers.ravel().tolist(), corners, strict=True))
    known = [tag for tag in tags.tags if tag.number in seen]
    if not known:
        return None
    points = np.concatenate([tag.corners for tag in known])
    return points, np.concatenate([seen[tag.number].reshape(4, 2) for tag in known]).astype(np.float64)


def _charuco(cv2: ModuleType, charuco: Charuco) -> Any:
    dictionary = _dictionary(cv2, charuco.dictionary)
    needed = charuco.columns * charuco.rows // 2
    if len(dictionary.bytesList) < needed:
        raise InputError(f"{charuco.dictionary} has too few markers; the board needs {needed}")
    size = (charuco.columns, charuco.rows)
    return cv2.aruco.CharucoBoard(size, charuco.square, charuco.marker, dictionary)


def _dictionary(cv2: ModuleType, name: str) -> Any:
    if not name.startswith("DICT_") or not hasattr(cv2.aruco, name):
        raise InputError(f"unknown dictionary {name!r}; e.g. DICT_4X4_50 or DICT_APRILTAG_36h11")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
