"""Where the camera sits on the flange, from photos of a printed board: closed forms, then all at once.

Of every photo two poses are known: the flange's, from the robot, and the board's, from the photo. The unknown
two, flange from camera and base from board, must make a loop with them. Closed forms (OpenCV's) solve for the
first alone and disagree by millimetres; the refinement seeks both so that the board is where the photos show
it, in pixels, which is what is measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from neugrasp.errors import InputError, require
from neugrasp.geometry.pose import Array, from_rotation_vector, inverse, to_rotation_vector

FEWEST = 4
"""Photos from which anything follows."""
ENOUGH = 10
"""Photos from which a calibration is believed."""
GOOD_MM, GOOD_PX = 2.5, 0.002
"""Millimetres of spread, and pixels as a part of the focal length, up to which a calibration is good."""
SURE_MM, SURE_DEG = 1.0, 0.2
"""Standard deviations of the result that a good calibration stays below."""
FARTHEST = 10.0
"""Metres that a flange may move between photos."""
ACROSS = 4
"""Points along each edge of the board that stand for it."""
SOLVERS = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")


@dataclass(frozen=True)
class Sightings:
    """What is known of n photos."""

    base_from_flange: Array
    """(n, 4, 4)"""
    camera_from_board: Array
    """(n, 4, 4)"""
    board_size: tuple[float, float]
    """Metres."""
    focal: float
    """Pixels."""

    def __len__(self) -> int:
        return len(self.base_from_flange)


@dataclass(frozen=True)
class HandEye:
    """A calibration, and how well it fits."""

    flange_from_camera: Array
    base_from_board: Array
    spread_mm: float
    """Mean distance of the board's origin, as the photos put it into the base frame, from its mean."""
    solvers_mm: Mapping[str, float]
    """The same of every closed form."""
    error_px: float
    """Root mean square distance of the board's points from where the photos show them."""
    worst: tuple[int, float]
    """The photo that fits worst, and its pixels."""
    doubt_mm: float
    doubt_deg: float
    """One standard deviation of the camera's place and direction, the worst axis."""
    problems: tuple[str, ...]
    """Why it is weak; empty where it is good."""


def calibrated(seen: Sightings) -> HandEye:
    """The calibration. Raises `InputError` where the photos are too few or all alike, `MissingExtra` without
    OpenCV."""
    if len(seen) < FEWEST:
        raise InputError(f"the board is known in {len(seen)} photos; a hand-eye calibration needs {FEWEST}")
    span = float(np.ptp(seen.base_from_flange[:, :3, 3], axis=0).max())
    if span > FARTHEST:
        raise InputError(f"base_from_flange moves by {span:.4g} m, which looks like millimetres; give metres")
    turns = [_turn(seen.base_from_flange[0], pose) for pose in seen.base_from_flange[1:]]
    if max(turns) < np.deg2rad(10):
        raise InputError("the flange hardly turns between the photos; tilt the camera by 20 degrees and more")
    closed = _closed_forms(seen)
    spreads = {name: _spread_mm(seen, pose) for name, pose in closed.items()}
    best = min(spreads, key=lambda name: spreads[name])
    found = _refined(seen, closed[best], spreads)
    if found.spread_mm > GOOD_MM and _fits_inverted(seen, found.spread_mm):
        hint = "base_from_flange looks like flange_from_base: write the inverse"
        return replace(found, problems=(hint, *found.problems))
    return found


def _fits_inverted(seen: Sightings, spread_mm: float) -> bool:
    """Whether the photos agree far better about the board if the flange's poses are inverted."""
    turned = replace(seen, base_from_flange=inverses(seen.base_from_flange))
    try:
        return min(_spread_mm(turned, pose) for pose in _closed_forms(turned).values()) < spread_mm / 4
    except InputError:
        return False


def _turn(one: Array, other: Array) -> float:
    return float(np.linalg.norm(to_rotation_vector(inverse(one) @ other)))


def _closed_forms(seen: Sightings) -> dict[str, Array]:
    """OpenCV's, by name."""
    cv2 = require("cv2", extra="capture")
    flange, board = seen.base_from_flange, seen.camera_from_board
    found = {}
    for name in SOLVERS:
        method = getattr(cv2, f"CALIB_HAND_EYE_{name}")
        try:
            turn, shift = cv2.calibrateHandEye(
                flange[:, :3, :3], flange[:, :3, 3], board[:, :3, :3], board[:, :3, 3], method=method
            )
        except cv2.error:
            continue
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, shift.ravel()
        if np.all(np.isfinite(pose)):
            found[name] = pose
    if not found:
        raise InputError(
            "no pose of the camera fits the photos at all; does each photo have its own pose, in the "
            "same order?"
        )
    return found


def _spread_mm(seen: Sightings, flange_from_camera: Array) -> float:
    origins = (seen.base_from_flange @ flange_from_camera @ seen.camera_from_board)[:, :3, 3]
    return float(1000 * np.linalg.norm(origins - origins.mean(axis=0), axis=1).mean())


def _refined(seen: Sightings, first: Array, spreads: Mapping[str, float]) -> HandEye:
    origins = seen.base_from_flange @ first @ seen.camera_from_board
    middle = int(np.linalg.norm(origins[:, :3, 3] - origins[:, :3, 3].mean(axis=0), axis=1).argmin())
    points = _board_points(seen.board_size)
    shown = _pixels(seen, seen.camera_from_board, points)

    def misfit(unknowns: Array) -> Array:
        board = inverses(seen.base_from_flange @ _pose(unknowns[:6])) @ _pose(unknowns[6:])
        return (_pixels(seen, board, points) - shown).ravel()

    start = np.concatenate([_vector(first), _vector(origins[middle])])
    solved = least_squares(misfit, start, x_scale="jac", loss="soft_l1")
    camera, board = _pose(solved.x[:6]), _pose(solved.x[6:])
    apart = np.linalg.norm(misfit(solved.x).reshape(len(seen), -1, 2), axis=-1)
    error = float(np.sqrt((apart**2).mean()))
    # Points of one board err together: a photo counts as one measurement of its six numbers.
    variance = error**2 * (len(points) / 3) * len(seen) / max(len(seen) - 2, 1)
    slopes = least_squares(misfit, solved.x, x_scale="jac", max_nfev=1).jac
    doubts = np.sqrt(np.diag(np.linalg.pinv(slopes.T @ slopes)) * variance)
    each = np.sqrt((apart**2).mean(axis=1))
    result = HandEye(
        flange_from_camera=camera,
        base_from_board=board,
        spread_mm=_spread_mm(seen, camera),
        solvers_mm=spreads,
        error_px=error,
        worst=(int(each.argmax()), float(each.max())),
        doubt_mm=float(1000 * doubts[3:6].max()),
        doubt_deg=float(np.rad2deg(doubts[:3].max())),
        problems=(),
    )
    return HandEye(**{**vars(result), "problems": tuple(_problems(seen, result))})


def _problems(seen: Sightings, found: HandEye) -> list[str]:
    limit = GOOD_PX * seen.focal
    checks = (
        (len(seen) < ENOUGH, f"{len(seen)} photos; take {ENOUGH} or more, from all sides and tilts"),
        (
            found.spread_mm > GOOD_MM,
            f"the board's origin spreads by {found.spread_mm:.1f} mm, {GOOD_MM} are good; are the poses "
            "those that the robot measured at the moment of the photo, and is the board fixed and flat?",
        ),
        (found.error_px > limit, f"the board is {found.error_px:.1f} pixels off, {limit:.1f} are good"),
        (
            found.doubt_mm > SURE_MM or found.doubt_deg > SURE_DEG,
            f"known to {found.doubt_mm:.1f} mm and {found.doubt_deg:.2f} degrees only; "
            f"{SURE_MM:g} mm and {SURE_DEG:g} degrees are good: turn the camera more about all axes",
        ),
    )
    return [words for is_so, words in checks if is_so]


def inverses(poses: Array) -> Array:
    """The inverses (n, 4, 4) of rigid transforms."""
    turned = np.swapaxes(poses[:, :3, :3], 1, 2)
    result = np.tile(np.eye(4), (len(poses), 1, 1))
    result[:, :3, :3] = turned
    result[:, :3, 3] = -np.einsum("nij,nj->ni", turned, poses[:, :3, 3])
    return result


def _board_points(size: tuple[float, float]) -> Array:
    x, y = (np.linspace(0, edge, ACROSS) for edge in size)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.column_stack([grid, np.zeros(len(grid))])


def _pixels(seen: Sightings, camera_from_board: Array, points: Array) -> Array:
    """Where the points are seen (n, p, 2), pixels from the middle of a photo without distortion."""
    placed = np.einsum("nij,pj->npi", camera_from_board[:, :3, :3], points)
    placed = placed + camera_from_board[:, None, :3, 3]
    pixels: Array = seen.focal * placed[..., :2] / placed[..., 2:]
    return pixels


def _pose(vector: Array) -> Array:
    return from_rotation_vector(vector[:3], vector[3:])


def _vector(pose: Array) -> Array:
    return np.concatenate([to_rotation_vector(pose), pose[:3, 3]])
