"""Which of the detected grasps are wanted: where, from which side, how many."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from neugrasp.data.photo_files import read_image
from neugrasp.detection.contract import Detection
from neugrasp.detection.options import Steering
from neugrasp.detection.things import nearest, things_in
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp, Grasps
from neugrasp.observation import Views

logger = logging.getLogger(__name__)


MOST_GREY = 0.25
"""Share of a mask that may be neither black nor white, such as soft edges."""


def steered(detection: Detection, steering: Steering, views: Views | None = None) -> Detection:
    """The detection with the wanted grasps alone, the others counted by reason.

    A mask needs the `views`. Raises `InputError` where it does not belong to one of them, or one object is
    wanted of a detector without a surface.
    """
    is_masked = _masked(steering, views)
    _tell_of_region(steering, detection.workspace)
    kept, rejected = detection.grasps, dict(detection.rejected)

    def those(is_wanted: Callable[[Grasp], bool]) -> Callable[[Grasps], Grasps]:
        return lambda grasps: grasps[np.array([is_wanted(grasp) for grasp in grasps], dtype=bool)]

    rules: dict[str, Callable[[Grasps], Grasps]] = {
        "outside_the_region": those(lambda grasp: _is_inside(steering, grasp)),
        "outside_the_mask": those(is_masked),
        "from_another_side": those(lambda grasp: _is_approached(steering, grasp)),
        "too_low": those(lambda grasp: _is_high(steering, grasp, detection.workspace)),
        "on_another_object": lambda grasps: _on_one(grasps, detection) if steering.one_object else grasps,
        "beyond_the_best": lambda grasps: grasps[: steering.top],
    }
    for reason, wanted in rules.items():
        left = wanted(kept)
        if len(left) < len(kept):
            rejected[reason] = len(kept) - len(left)
        kept = left
    return replace(detection, grasps=kept, rejected=rejected)


def _tell_of_region(steering: Steering, workspace: Workspace) -> None:
    """Warns of a region that holds all of the cube or nothing of it: it may be in other units or axes."""
    if steering.region is None:
        return
    corners = workspace.to_world(workspace.corners(0, workspace.size))
    low, high = np.array(steering.region[:3]), np.array(steering.region[3:])
    if np.all((corners >= low) & (corners <= high)):
        what = "all of the cube lies in it"
    elif np.any(corners.max(axis=0) < low) or np.any(corners.min(axis=0) > high):
        what = "the cube lies outside of it"
    else:
        return
    logger.warning(
        "--region: %s, which reaches from %s to %s in the world; the region must be in metres and in the "
        "world of scene.json",
        what,
        np.round(corners.min(axis=0), 3).tolist(),
        np.round(corners.max(axis=0), 3).tolist(),
    )


def check_mask(steering: Steering, views: Views) -> None:
    """Raises `InputError` where the mask does not belong to one of the views."""
    _masked(steering, views)


def _on_one(grasps: Grasps, detection: Detection) -> Grasps:
    """Those of the object that the best one is at."""
    if len(grasps) < 2:
        return grasps
    workspace = detection.workspace
    things = things_in(detection.grid(), workspace)
    at = np.array([nearest(things, grasp.position, workspace) for grasp in grasps])
    return grasps[at == at[0]]


def _masked(steering: Steering, views: Views | None) -> Callable[[Grasp], bool]:
    """Whether a grasp is seen where the mask is bright."""
    if steering.mask is None:
        return lambda _: True
    number, file = steering.mask
    if views is None or not 0 <= number < len(views):
        count = 0 if views is None else len(views)
        raise InputError(f"--mask {number} {file}: there are views 0 to {count - 1}")
    values, camera = read_image(file, "--mask").max(axis=2), views.frames[number].camera
    bright = values > 127
    if bright.shape != (camera.height, camera.width):
        raise InputError(
            f"--mask {number} {file}: {bright.shape[1]} x {bright.shape[0]} pixels; photo {number} has "
            f"{camera.width} x {camera.height}"
        )
    if bright.all() or not bright.any():
        # Masks of 0 and 1 look black, and those cut out by transparency may look like anything.
        what = "all of it is" if bright.all() else "nothing in it is"
        raise InputError(
            f"--mask {number} {file}: {what} brighter than half; what is wanted must be white (255, not 1) "
            "and the rest black, without transparency"
        )
    if (grey := float(np.mean((values > 31) & (values < 224)))) > MOST_GREY:
        raise InputError(
            f"--mask {number} {file}: {100 * grey:.0f} % of it are grey, as of a photo; what is wanted must "
            "be white and the rest black"
        )

    def is_masked(grasp: Grasp) -> bool:
        (column, row), depth = camera.project(grasp.position)
        column, row = round(float(column)), round(float(row))
        inside = depth > 0 and 0 <= row < bright.shape[0] and 0 <= column < bright.shape[1]
        return bool(inside and bright[row, column])

    return is_masked


def _is_inside(steering: Steering, grasp: Grasp) -> bool:
    if steering.region is None:
        return True
    low, high = np.array(steering.region[:3]), np.array(steering.region[3:])
    return bool(np.all((grasp.position >= low) & (grasp.position <= high)))


def _is_approached(steering: Steering, grasp: Grasp) -> bool:
    if steering.approach is None:
        return True
    *direction, degrees = steering.approach
    cosine = grasp.approach @ np.array(direction) / np.linalg.norm(direction)
    return bool(np.degrees(np.arccos(np.clip(cosine, -1, 1))) <= degrees + 1e-9)


def _is_high(steering: Steering, grasp: Grasp, workspace: Workspace) -> bool:
    if steering.min_height is None:
        return True
    up, origin = workspace.world_from_workspace[:3, 2], workspace.world_from_workspace[:3, 3]
    return bool((grasp.position - origin) @ up - workspace.table_height >= steering.min_height)
