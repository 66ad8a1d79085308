"""Finds a printed board in photos, calibrates a lens by it, and draws it. The only file that uses OpenCV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np

from neugrasp.errors import InputError, require
from neugrasp.geometry.lens import Lens
from neugrasp.geometry.pose import Array, rigid
from neugrasp.importers.board import Board, Charuco, Tag, Tags
from neugrasp.importers.board_reasons import charuco_reason, missing_row, tags_reason
from neugrasp.importers.planar_fit import limit_of
from neugrasp.importers.seen_markers import Seen, listed, named, once, straightened
from neugrasp.observation import Image

FEWEST_POINTS = 6
"""Corners of a chessboard that fix a pose well; one tag has four."""
FEWEST_STRANGERS = {4: 4, 5: 2}
"""Markers of another dictionary that are believed, by their bits across; clutter holds small patterns, "
"too."""
NOISE = 0.15
"""Pixels by which one of two poses must fit better than the other, and twice as well, to be told from it."""
LARGEST_DOUBT = 2.0
"""Degrees of standard deviation: at half a metre they move the camera by 17 mm."""
FINEST = 0.1
"""Pixels that every corner may be off, however well all of them fit."""
SAME_TURN = 5.0
"""Degrees between two poses that count as one."""

Found = tuple[Array, Array]
"""Points (n, 3) of the board and their pixels (n, 2)."""


@dataclass(frozen=True)
class Sighting:
    """A board in a photo."""

    camera_from_board: Array
    """4x4, metres, OpenCV axes."""
    error: float
    """Root mean square distance of the corners from where the pose puts them, pixels."""
    num_points: int
    rival: float = np.inf
    """The error of the best pose from another direction."""
    doubt: float = 0.0
    """Degrees, one standard deviation, within which the camera's direction is known."""


def find_board(board: Board, photo: Image, lens: Lens) -> Sighting | None:
    """The pose of the board in a photo as the lens took it, with distortion; None where it is not seen.

    Raises `InputError` with the reason where it is seen and is not as described.
    """
    cv2 = require("cv2", extra="capture")
    found = _corners(cv2, board, photo, lens)
    if found is None:
        return None
    sighting = _pose(cv2, *found, lens)
    if sighting.error > (limit := limit_of(lens.width, lens.height)):
        raise InputError(_misfit(cv2, board, photo, lens, sighting.error, limit))
    if sighting.rival < max(sighting.error + NOISE, 2 * sighting.error) or sighting.doubt > LARGEST_DOUBT:
        raise InputError(
            f"the {len(found[0])} corners of the board that are seen do not tell the camera's direction "
            f"within {LARGEST_DOUBT:g} degrees; go nearer, look at it more from the side, or print it larger"
        )
    return sighting


def other_markers(board: Board, photo: Image) -> str | None:
    """What is printed in a photo in which the board is not seen; None where there is nothing of the kind."""
    cv2 = require("cv2", extra="capture")
    picture = _grey(cv2, photo)
    wanted = board.print.dictionary
    numbers = [number for number, _ in _markers(cv2, wanted, picture)]
    if isinstance(board.print, Tags) and numbers:
        ours = ", ".join(str(tag.number) for tag in board.print.tags)
        return f"the tags {listed(numbers)} of {wanted} are seen, the board has {ours}"
    names = sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))
    seen = {name: [n for n, _ in _markers(cv2, name, picture)] for name in names}
    # Of those that hold the same markers, the smallest; weak families need more of them.
    best = max(names, key=lambda name: (len(seen[name]), -len(_dictionary(cv2, name).bytesList)))
    if len(seen[best]) < FEWEST_STRANGERS.get(_dictionary(cv2, best).markerSize, 1):
        return None
    return f"markers of {best} are seen ({listed(seen[best])}), the board has {wanted}"


def tags_in(tags: Tags, photo: Image) -> Seen:
    """Those of the tags that a photo shows, corners from the upper left of the upright tag on clockwise (of
    the official picture where nothing was said). Raises `InputError` where one is there twice."""
    cv2 = require("cv2", extra="capture")
    ours = {tag.number for tag in tags.tags}
    return {n: pixels for n, pixels in _tags_seen(cv2, tags, _grey(cv2, photo)).items() if n in ours}


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
        reason = other_markers(board, photos[0])
        raise InputError(
            f"the board was found in {len(found)} of {len(photos)} photos; a calibration needs it in 3, "
            "better in 10, from different sides and tilts (or give camera.json)"
            + (f". In the first of them {reason}" if reason else "")
        )
    # OpenCV calibrates from float32 only.
    points, pixels = ([values.astype(np.float32) for values in part] for part in zip(*found, strict=True))
    # One coefficient of distortion: more of them fit the board and go astray where it never was.
    flags = cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    error, matrix, bend, _, _ = cv2.calibrateCamera(points, pixels, (width, height), None, None, flags=flags)
    if not error <= limit_of(width, height):
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
        marker = np.ascontiguousarray(np.rot90(marker, -_quarter_turns(cv2, tags)))
        place = tag.corners[:, :2] * [1, -1] * dots_per_metre + [0, height] - 0.5
        warp = cv2.getPerspectiveTransform(upright, place.astype(np.float32))
        smooth = cv2.warpPerspective(marker, warp, (width, height), flags=cv2.INTER_AREA, borderValue=255)
        sheet = np.minimum(sheet, smooth)
    return sheet


def _check_number(dictionary: Any, tags: Tags, tag: Tag) -> None:
    count = len(dictionary.bytesList)
    if not 0 <= tag.number < count:
        raise InputError(f"tag {tag.number}: {tags.dictionary} has tags 0 to {count - 1}")


def _check_printable(dictionary: Any, tags: Tags, tag: Tag) -> None:
    _check_number(dictionary, tags, tag)
    if tag.corners[:, :2].min() < -1e-9:
        raise InputError(
            f"tag {tag.number}: reaches past the lower left corner of the board, which is its origin"
        )


def _quarter_turns(cv2: ModuleType, tags: Tags) -> int:
    """By how many quarter turns against the clock the library draws the tags, seen from how they are "
    "upright."""
    bits = tags.first_picture
    if bits is None:
        return 0
    dictionary = _dictionary(cv2, tags.dictionary)
    drawn = cv2.aruco.generateImageMarker(dictionary, 0, len(bits) + 2, borderBits=1)[1:-1, 1:-1] > 0
    turns = next((turns for turns in range(4) if np.array_equal(np.rot90(bits, turns), drawn)), None)
    if turns is None:
        raise InputError(f"{tags.dictionary}: this version of OpenCV draws tag 0 in a way that is not known")
    return (turns + 2) % 4 if tags.upright == "opencv" else turns


def _corners(cv2: ModuleType, board: Board, photo: Image, lens: Lens | None = None) -> Found | None:
    """Points of the board and their pixels, None where there are too few."""
    picture = _grey(cv2, photo)
    if isinstance(board.print, Tags):
        seen = _tags_seen(cv2, board.print, picture)
        known = [tag for tag in board.print.tags if tag.number in seen]
        if not known:
            return None
        points = np.concatenate([tag.corners for tag in known])
        return points, np.concatenate([seen[tag.number] for tag in known])
    chessboard = _charuco(cv2, board.print)
    pixels, numbers, markers, ids = cv2.aruco.CharucoDetector(chessboard).detectBoard(picture)
    seen = once(named(markers, ids), range(len(board.print.markers())), "marker")
    straight = straightened(seen, lens)
    size = (picture.shape[1], picture.shape[0])
    if reason := charuco_reason(board.print, straight) or missing_row(board.print, straight, *size):
        raise InputError(reason)
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


def _pose(cv2: ModuleType, points: Array, pixels: Array, lens: Lens) -> Sighting:
    """The pose that puts the points nearest to their pixels."""
    camera = (lens.intrinsics, lens.coefficients)
    _, turns, shifts, _ = cv2.solvePnPGeneric(points, pixels, *camera, flags=cv2.SOLVEPNP_IPPE)
    found = []
    # A plane seen from afar can be explained in two ways; both are refined, and the better one is kept.
    for first, second in zip(turns, shifts, strict=True):
        turn, shift = cv2.solvePnPRefineLM(points, pixels, *camera, first, second)
        expected, slopes = cv2.projectPoints(points, turn, shift, *camera)
        error = float(np.sqrt(((expected.reshape(-1, 2) - pixels) ** 2).sum(axis=1).mean()))
        spread = np.linalg.pinv(slopes[:, :6].T @ slopes[:, :6])[:3, :3] * max(error, FINEST) ** 2
        doubt = float(np.rad2deg(np.sqrt(np.linalg.eigvalsh(spread)[-1])))
        found.append(Sighting(rigid(cv2.Rodrigues(turn)[0], shift.ravel()), error, len(points), doubt=doubt))
    best, *others = sorted(found, key=lambda sighting: sighting.error)
    rivals = [other.error for other in others if _turn(best, other) > SAME_TURN]
    return replace(best, rival=min(rivals, default=np.inf))


def _turn(one: Sighting, other: Sighting) -> float:
    """Degrees between two poses."""
    trace = np.trace(one.camera_from_board[:3, :3].T @ other.camera_from_board[:3, :3])
    return float(np.rad2deg(np.arccos(np.clip((trace - 1) / 2, -1, 1))))


def _misfit(cv2: ModuleType, board: Board, photo: Image, lens: Lens, error: float, limit: float) -> str:
    """Why the board does not fit."""
    text = f"the board does not fit: its corners are {error:.1f} pixels off, {limit:.1f} are believed"
    if isinstance(board.print, Tags):
        seen = straightened(_tags_seen(cv2, board.print, _grey(cv2, photo)), lens)
        blurred = "is the photo sharp? If so, " if error < 3 * limit else ""
        return f"{text}; {blurred}{tags_reason(board.print, seen, limit)}"
    return f"{text}; is it flat, of the given size, and the lens that of this camera at this resolution?"


def _tags_seen(cv2: ModuleType, tags: Tags, picture: np.ndarray) -> dict[int, Array]:
    """Corners (4, 2) of the board's tags, from the upper left of the upright tag on clockwise."""
    turns = _quarter_turns(cv2, tags)
    for tag in tags.tags:
        _check_number(_dictionary(cv2, tags.dictionary), tags, tag)
    seen = once(_markers(cv2, tags.dictionary, picture), [tag.number for tag in tags.tags], "tag")
    return {number: np.roll(corners, turns, axis=0) for number, corners in seen.items()}


def _markers(cv2: ModuleType, dictionary: str, picture: np.ndarray) -> list[tuple[int, Array]]:
    """Numbers and corners (4, 2) of all markers of a dictionary."""
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(_dictionary(cv2, dictionary), settings)
    corners, numbers, _ = detector.detectMarkers(picture)
    return named(corners, numbers)


def _grey(cv2: ModuleType, photo: Image) -> np.ndarray:
    picture: np.ndarray = cv2.cvtColor(np.ascontiguousarray(photo), cv2.COLOR_RGB2GRAY)
    return picture


def _charuco(cv2: ModuleType, charuco: Charuco) -> Any:
    dictionary = _dictionary(cv2, charuco.dictionary)
    needed = len(charuco.markers())
    if len(dictionary.bytesList) < needed:
        raise InputError(f"{charuco.dictionary} has too few markers; the board needs {needed}")
    size = (charuco.columns, charuco.rows)
    board = cv2.aruco.CharucoBoard(size, charuco.square, charuco.marker, dictionary)
    board.setLegacyPattern(charuco.legacy)
    return board


def _dictionary(cv2: ModuleType, name: str) -> Any:
    if not name.startswith("DICT_") or not hasattr(cv2.aruco, name):
        raise InputError(f"unknown dictionary {name!r}; e.g. DICT_4X4_50 or DICT_APRILTAG_36h11")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
