"""Which convention and which unit the poses are in: the one in which the cameras look down at the cube."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from neugrasp.doctor.capture import Capture
from neugrasp.doctor.findings import Finding, Level, green, views_text
from neugrasp.doctor.messages import (
    CAMERA_BELOW_TABLE,
    CUBE_NOT_SEEN,
    INVERTED_WORKSPACE,
    ONE_VIEW_MISSES,
    UNITS,
)
from neugrasp.doctor.pose_conventions import RARE, USUAL, PoseConvention
from neugrasp.doctor.table import comparable, mean_correlation, table_pictures
from neugrasp.doctor.table_crop import table_crops
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import Views

NEAREST, FARTHEST = 0.1, 3.0
"""Metres between a camera and the middle of the table."""
SEEN = 0.25
"""Share of the cube that a view must see to make sense."""
POSSIBLE = 0.01
"""Share of the cube in all views with which they are looked at as they are, where nothing explains them."""
CONFIRMED = 0.5
"""Agreement about the table from which on an unlikely convention is believed."""
CLEAR = 0.15
"""By how much the tables of one convention must agree better than those of the next."""
Candidate = tuple[PoseConvention, Views]
"""A way to understand a scene, and the scene understood that way."""


def check_convention(capture: Capture) -> tuple[Capture, list[Finding]]:
    """The capture with its poses understood, and what was wrong; unchanged where the cause is not certain."""
    views = capture.views
    good = plausible(views)
    fine = [green("convention", "OpenCV, world_from_camera"), green("units", _distances(views))]
    if all(good):
        return capture, fine
    is_possible = all(plausible(views, POSSIBLE))
    everything, bad_ones = [True] * len(good), [not is_good for is_good in good]
    for only in [everything] * (sum(good) <= len(good) / 2) + [bad_ones] * any(good):
        is_doubtful = is_possible or only != everything
        if candidates := _candidates(views, only, is_doubtful):
            return _decided(capture, candidates, only)
    return capture, fine if is_possible else _unexplained(views, good)


def _candidates(views: Views, only: Sequence[bool], is_doubtful: bool) -> list[Candidate]:
    """The conventions of the chosen views that the photos confirm, or else those that may be believed."""
    usual = _simplest(views, only, USUAL)
    for found in (usual, _simplest(views, only, RARE)):
        if confirmed := [entry for entry in found if _agreement(entry[1], only) >= CONFIRMED]:
            return confirmed
    return [] if is_doubtful else usual


def _simplest(views: Views, only: Sequence[bool], conventions: Sequence[PoseConvention]) -> list[Candidate]:
    """The conventions in which all is plausible and the fewest mistakes, each once."""
    found: list[Candidate] = []
    for convention in sorted(conventions, key=lambda one: one.mistakes):
        if found and convention.mistakes > found[0][0].mistakes:
            break
        read = understood(views, convention, only)
        if all(plausible(read)) and not any(_is_same(read, other) for _, other in found):
            found.append((convention, read))
    return found


def _is_same(one: Views, other: Views) -> bool:
    return bool(np.allclose(_poses(one), _poses(other)))


def _poses(views: Views) -> Array:
    """The cube and all cameras (1 + n, 4, 4)."""
    cameras = [view.camera.world_from_camera for view in views.frames]
    return np.stack([views.workspace.world_from_workspace, *cameras])


def _agreement(views: Views, only: Sequence[bool]) -> float:
    """Agreement of the chosen photos with all others about the table, 0 where they cannot be compared."""
    pictures = table_pictures(table_crops(views), views.workspace)
    pairs = [(i, j) for i, j in comparable(pictures) if only[i] or only[j]]
    return mean_correlation(pictures, pairs) if pairs else 0.0


def understood(views: Views, convention: PoseConvention, only: Sequence[bool]) -> Views:
    """The scene with the chosen views, and the cube, read another way."""
    changed = [
        replace(view, camera=convention.camera(view.camera)) if is_meant else view
        for view, is_meant in zip(views.frames, only, strict=True)
    ]
    return Views(tuple(changed), convention.workspace(views.workspace))


def is_examinable(views: Views) -> bool:
    """Whether the photos can be asked: some view sees enough of the cube, or all see a little of it."""
    return any(plausible(views)) or all(plausible(views, POSSIBLE))


def plausible(views: Views, share: float = SEEN) -> list[bool]:
    """For each view whether its camera stands above the table, at a possible distance, and sees enough of the
    cube."""
    return [_plausible(view.camera, views.workspace, share) for view in views.frames]


def _plausible(camera: Camera, workspace: Workspace, share: float) -> bool:
    camera = camera.moved(inverse(workspace.world_from_workspace))
    offset = camera.centre - workspace.centre
    if not (NEAREST < np.linalg.norm(offset) < FARTHEST and offset[2] > 0.05):
        return False
    return bool(in_view(camera, slab(workspace)).mean() >= share)


def slab(workspace: Workspace, count: int = 8) -> Array:
    """Points (n, 3) of the cube between the table and the height of objects, workspace frame."""
    flat = (np.arange(count) + 0.5) * workspace.size / count
    upright = workspace.table_height + np.linspace(0, workspace.photo_height, 4)
    return np.stack(np.meshgrid(flat, flat, upright, indexing="ij"), axis=-1).reshape(-1, 3)


def in_view(camera: Camera, points: Array) -> np.ndarray:
    """Whether points (n, 3) of the camera's frame of reference lie in its photo."""
    pixels, depth = camera.project(points)
    left, top, right, bottom = camera.bounds
    u, v = pixels[..., 0], pixels[..., 1]
    return np.asarray((depth > 0.01) & (u >= left) & (u <= right) & (v >= top) & (v <= bottom))


def _decided(
    capture: Capture, candidates: list[Candidate], only: list[bool]
) -> tuple[Capture, list[Finding]]:
    """Chooses among several conventions the one in which the photos agree best about the table."""
    if len(candidates) > 1:
        scores = [_agreement(views, only) for _, views in candidates]
        order = np.argsort(scores)[::-1]
        if scores[order[0]] - scores[order[1]] < CLEAR:
            names = " or ".join(meant.words for meant, _ in candidates[:3])
            return capture, [Finding("convention", Level.RED, f"the cube is seen if: {names}", CUBE_NOT_SEEN)]
        candidates = [candidates[order[0]]]
    meant, views = candidates[0]
    where = () if all(only) else tuple(i for i, is_meant in enumerate(only) if is_meant)
    findings = []
    if meant.frames is not None:
        text = f"as written the cube is not seen; it is if {meant.words}"
        findings.append(Finding("convention", Level.RED, text, meant.frames, where))
    if meant.workspace_inverted:
        text = "the cube is seen if world_from_workspace is inverted"
        findings.append(Finding("convention", Level.RED, text, INVERTED_WORKSPACE))
    if (meant.camera_unit, meant.workspace_unit) != (1.0, 1.0):
        text = f"{_distances(capture.views)} as written; {replace(meant, frames=None).words} fits"
        findings.append(Finding("units", Level.RED, text, UNITS, where))
    return replace(capture, views=views), findings


def _unexplained(views: Views, good: list[bool]) -> list[Finding]:
    bad = tuple(i for i, is_good in enumerate(good) if not is_good)
    text = f"not seen by {views_text(bad)}; {_distances(views)}"
    if any(good):
        return [Finding("convention", Level.RED, text, ONE_VIEW_MISSES, bad)]
    below = [
        (inverse(views.workspace.world_from_workspace) @ v.camera.world_from_camera)[2, 3]
        for v in views.frames
    ]
    if all(height < views.workspace.table_height for height in below):
        text = f"cameras {views.workspace.table_height - max(below):.2f} m below the table"
        return [Finding("convention", Level.RED, text, CAMERA_BELOW_TABLE)]
    return [Finding("convention", Level.RED, text, CUBE_NOT_SEEN)]


def _distances(views: Views) -> str:
    middle = views.workspace.to_world(views.workspace.centre)
    distances = [float(np.linalg.norm(view.camera.centre - middle)) for view in views.frames]
    return f"cameras {min(distances):.3g} to {max(distances):.3g} m from the table"
