"""A scene read as far as it can be read: what `read_scene` refuses becomes a finding here."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.scene_folder import FILE, read_json, view_of, workspace_of
from neugrasp.doctor.findings import Finding, Level, Problem, green
from neugrasp.doctor.messages import INTRINSICS_UNIT, NOT_RIGID, TRANSPOSED, UNITS, UNREADABLE
from neugrasp.doctor.photo_tags import check_tags
from neugrasp.errors import InputError
from neugrasp.geometry.pose import is_rigid
from neugrasp.observation import MAX_VIEWS, View, Views


@dataclass(frozen=True)
class Capture:
    """Photos and cameras as they were written down, before anybody trusts them."""

    views: Views
    numbers: tuple[int, ...]
    """The place of each view in scene.json; unreadable ones are left out."""
    backgrounds: tuple[int, ...]
    """The view of `views` whose background file each view uses; its own unless that was mended."""
    images: tuple[int, ...]
    """The same of images."""
    exchanged: tuple[int, ...] = ()
    """Views whose image and background have been exchanged to mend them."""

    @classmethod
    def of(cls, views: Views) -> Capture:
        """A scene that is in memory."""
        own = tuple(range(len(views)))
        return cls(views, own, own, own)

    def with_views(self, views: list[View]) -> Capture:
        """The same capture with other photos or cameras."""
        return replace(self, views=replace(self.views, frames=tuple(views)))


@dataclass(frozen=True)
class Reading:
    """What a folder gave."""

    capture: Capture | None
    """None where no view could be read."""
    findings: tuple[Finding, ...]
    data: dict[str, Any] = field(default_factory=dict)
    """The content of scene.json, transposed matrices and a size in millimetres already mended."""
    mended: bool = False
    """Whether `data` differs from the file."""


def read_capture(path: Path) -> Reading:
    """Every view of a scene folder that can be read, and what was wrong with the others."""
    file = path if path.name == FILE else path / FILE
    try:
        written = read_json(file)
        data, findings = _mended(written)
        workspace = workspace_of(data, file)
    except InputError as error:
        return Reading(None, (Finding("files", Level.RED, str(error), _problem(str(error))),))
    entries = data.get("views")
    if not isinstance(entries, list) or not 1 <= len(entries) <= MAX_VIEWS:
        text = f"{file}: 'views' must be a list of 1 to {MAX_VIEWS} views"
        return Reading(None, (Finding("files", Level.RED, text, UNREADABLE),), data)
    views: list[View] = []
    numbers: list[int] = []
    errors: dict[int, str] = {}
    for number, entry in enumerate(entries):
        try:
            views.append(view_of(entry, f"{file}, view {number}", file.parent))
            numbers.append(number)
        except InputError as error:
            errors[number] = str(error)
    findings += _unread(errors) or [green("files", _sizes(views))]
    capture = None
    if views:
        capture = replace(Capture.of(Views(tuple(views), workspace)), numbers=tuple(numbers))
    findings += check_tags(file.parent, [entries[number] for number in numbers], views)
    return Reading(capture, tuple(findings), data, mended=data != written)


def _mended(written: dict[str, Any]) -> tuple[dict[str, Any], list[Finding]]:
    """A copy without the mistakes that are certain before a photo is looked at."""
    data, findings = copy.deepcopy(written), []
    workspace, views = data.get("workspace"), data.get("views")
    if isinstance(workspace, dict):
        if workspace.get("size") == 300:
            workspace["size"] = 0.3
            findings.append(Finding("units", Level.RED, "workspace size 300 m, meant as millimetres", UNITS))
        if _is_transposed(workspace.get("world_from_workspace")):
            workspace["world_from_workspace"] = _transposed(workspace["world_from_workspace"])
            findings.append(Finding("poses", Level.RED, "world_from_workspace is transposed", TRANSPOSED))
    entries = [view for view in views if isinstance(view, dict)] if isinstance(views, list) else []
    turned = [i for i, view in enumerate(entries) if _is_transposed(view.get("world_from_camera"))]
    for i in turned:
        entries[i]["world_from_camera"] = _transposed(entries[i]["world_from_camera"])
    if turned:
        text = "the translation stands in the last row"
        findings.append(Finding("poses", Level.RED, text, TRANSPOSED, tuple(turned)))
    return data, findings


def _is_transposed(value: Any) -> bool:
    """Whether a matrix is no rigid transform and its transpose is one."""
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return False
    return matrix.shape == (4, 4) and not is_rigid(matrix) and is_rigid(matrix.T)


def _transposed(value: Any) -> list[list[float]]:
    rows: list[list[float]] = np.array(value, dtype=np.float64).T.tolist()
    return rows


def _unread(errors: dict[int, str]) -> list[Finding]:
    """One finding for each view that could not be read, and one for all with the same mistake in a matrix."""
    found = [Finding("files", Level.RED, text, _problem(text), (view,)) for view, text in errors.items()]
    merged = [finding for finding in found if finding.problem is UNREADABLE]
    for problem in (NOT_RIGID, INTRINSICS_UNIT):
        if same := [finding for finding in found if finding.problem is problem]:
            merged.append(replace(same[0], views=tuple(view for finding in same for view in finding.views)))
    return merged


def _problem(message: str) -> Problem:
    if "rigid transform" in message:
        return NOT_RIGID
    return INTRINSICS_UNIT if "are too short" in message else UNREADABLE


def _sizes(views: list[View]) -> str:
    sizes = sorted({(view.camera.width, view.camera.height) for view in views})
    return f"{2 * len(views)} photos, " + ", ".join(f"{width} x {height}" for width, height in sizes)


def tags_of(views: Views) -> list[Finding]:
    """What the photos of a scene that `read_scene` gave say of themselves."""
    folder = Path(views.source)
    return check_tags(folder, read_json(folder / FILE)["views"], views.frames)
