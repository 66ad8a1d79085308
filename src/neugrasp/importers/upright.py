"""Whose pictures AprilTags are, where that was not said: their family's, or OpenCV's, which are turned.

Two tags in one photo tell it, for where the one lies says how the other is turned. With one alone the same
photo can be read both ways; only the objects tell, which stand in the cube and not in its mirror image on the
other side of the tag.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np
from scipy import ndimage

from neugrasp.data.photo_files import read_image
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, apply, inverse
from neugrasp.importers.board import Board, Tags, Upright
from neugrasp.importers.board_reasons import fit_of
from neugrasp.importers.markers import tags_in
from neugrasp.importers.photos import Pair
from neugrasp.importers.planar_fit import mapped
from neugrasp.importers.seen_markers import Seen
from neugrasp.observation import Image

STEP = 0.005
"""Metres between the points of the table at which image and background are compared."""
REACH = 0.7
"""Metres around the tag."""
CHANGED = 30
"""Grey levels of 255 by which image and background differ where an object stands."""
FEWEST = 40
"""Points, 10 square centimetres, that must have changed in one of the two places in all views together."""
CLEAR = 4.0
"""How many times more must have changed in the one place than in the other."""
STILL = 2.0
"""Pixels by which a tag may move between image and background of a camera that stood still."""

logger = logging.getLogger(__name__)


def settled(board: Board, pairs: Mapping[str, Pair]) -> Board:
    """The board with the pictures that its AprilTags are of. Raises `InputError` where nothing tells."""
    tags = board.print
    if not isinstance(tags, Tags) or not tags.is_ambiguous:
        return board
    changed = {"official": 0, "opencv": 0}
    for pair in pairs.values():
        background, image = (read_image(file, "the board") for file in (pair.background, pair.image))
        seen = tags_in(tags, background)
        if len(seen) > 1:
            found = _by_two(tags, seen)
            logger.info("the tags are read as the %s pictures of their family: two of them tell", found)
            return board.drawn(found)
        if seen and image.shape == background.shape:
            for upright, count in _by_objects(board, background, image, seen, tags_in(tags, image)).items():
                changed[upright] += count
    for upright, other in (("official", "opencv"), ("opencv", "official")):
        if changed[upright] >= FEWEST and changed[upright] > CLEAR * changed[other]:
            logger.info(
                "the tag is read as the %s picture of its family: so the objects are in the cube", upright
            )
            return board.drawn(upright)  # type: ignore[arg-type]
    if not any(tags_in(tags, read_image(pair.background, "the board")) for pair in pairs.values()):
        return board.drawn("official")
    raise InputError(
        f"tag {tags.tags[0].number} alone does not tell which way up it is: OpenCV draws AprilTags turned by "
        '180 degrees. Write into the file of the board "upright": "official" where the print is that of '
        '`neugrasp board` or of github.com/AprilRobotics/apriltag-imgs, "upright": "opencv" where OpenCV '
        "drew it"
    )


def _by_two(tags: Tags, seen: Seen) -> Upright:
    """As which of the two the tags seen fit better."""
    corners = {tag.number: tag.corners for tag in tags.tags}
    official = fit_of(corners, seen)
    opencv = fit_of(corners, {number: np.roll(pixels, 2, axis=0) for number, pixels in seen.items()})
    assert official is not None
    assert opencv is not None
    return "opencv" if opencv.error < 0.5 * official.error else "official"


def _by_objects(
    board: Board, background: Image, image: Image, seen: Seen, seen_again: Seen
) -> dict[str, int]:
    """How many points of the table have changed where the cube would stand for each of the two alone."""
    assert isinstance(board.print, Tags)
    corners = {tag.number: tag.corners for tag in board.print.tags}
    (number,) = seen
    middle = corners[number].mean(axis=0)[:2]
    edge = np.arange(-REACH, REACH, STEP)
    points = np.stack(np.meshgrid(edge, edge), axis=-1).reshape(-1, 2) + middle
    in_background = fit_of(corners, seen)
    assert in_background is not None
    moved = number in seen_again and np.abs(seen_again[number] - seen[number]).max() > STILL
    in_image = fit_of(corners, seen_again) if moved else in_background
    assert in_image is not None
    one, other = _at(background, in_background.matrix, points), _at(image, in_image.matrix, points)
    difference = np.abs(one - other).max(axis=-1)
    is_changed = (
        difference - np.nanmedian(difference) > CHANGED if np.isfinite(difference).any() else difference > 0
    )
    cube = _in_cube(board, points)
    # Turned by half a turn about the tag: where the cube stands if the tag is upright the other way.
    turned = _in_cube(board, 2 * middle - points)
    return {
        "official": int((is_changed & cube & ~turned).sum()),
        "opencv": int((is_changed & turned & ~cube).sum()),
    }


def _in_cube(board: Board, points: Array) -> np.ndarray:
    """Which points (n, 2) of the table lie under the cube."""
    workspace = board.workspace()
    flat = np.concatenate([points, np.zeros((len(points), 1))], axis=-1)
    inside = apply(inverse(workspace.world_from_workspace), flat)[:, :2]
    return np.asarray(np.all((inside > 0) & (inside < workspace.size), axis=-1))


def _at(photo: Image, matrix: Array, points: Array) -> Array:
    """Colours (n, 3) of a photo at points of the table; NaN where it does not show them."""
    homogeneous = np.concatenate([points, np.ones((len(points), 1))], axis=-1) @ matrix.T
    # In front of the camera the sign is that of the tag's own corners, about which the points lie.
    is_ahead = homogeneous[:, 2] * np.median(homogeneous[:, 2]) > 0
    pixels = mapped(matrix, points)
    height, width = photo.shape[:2]
    with np.errstate(invalid="ignore"):
        is_seen = is_ahead & np.all((pixels >= 0) & (pixels <= [width - 1, height - 1]), axis=-1)
    places = np.where(is_seen[:, None], pixels, 0.0).T[::-1]
    colours = [ndimage.map_coordinates(photo[..., c].astype(np.float32), places, order=1) for c in range(3)]
    return np.where(is_seen[:, None], np.stack(colours, axis=-1), np.nan)
