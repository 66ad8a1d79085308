"""The corrected copy: the same photos, with poses, units and file names as they must have been meant."""

from __future__ import annotations

import copy
import json
import shutil
from pathlib import Path
from typing import Any

from neugrasp.data.scene_folder import FILE, photo_of
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.doctor.capture import Capture
from neugrasp.doctor.examination import Diagnosis, examine
from neugrasp.doctor.findings import Level
from neugrasp.errors import InputError


def write_fixed(diagnosis: Diagnosis, scene: Path, out: Path) -> None:
    """Writes the capture with every certain mistake undone into the new folder `out`, whole or not at all.

    Raises `InputError` where nothing is certain, where a photo cannot be read, or where `out` is in use.
    """
    folder = scene.parent if scene.name == FILE else scene
    unreadable = [f for f in diagnosis.findings if f.item == "files" and f.level == Level.RED]
    if diagnosis.capture is None or unreadable:
        raise InputError(f"{folder}: cannot be fixed: {unreadable[0].measured if unreadable else 'no view'}")
    if not diagnosis.is_mended:
        raise InputError(
            f"{folder}: nothing was found that can be corrected with certainty; nothing was written"
        )
    again = examine(diagnosis.capture)
    if _badness(again) >= _badness(diagnosis):
        raise InputError(
            f"{folder}: the correction would be no better ({again.verdict}); nothing was written. "
            f"{next(iter(again.lines(Level.YELLOW)), '')}"
        )
    if out.exists() and any(out.iterdir()):
        raise InputError(f"{out}: is not empty; name a new folder for the corrected copy")
    data = _corrected(diagnosis, diagnosis.capture)
    with whole_or_nothing(out, (FILE,)) as part:
        for number, entry in enumerate(data["views"]):
            for key in ("image", "background"):
                photo = photo_of(folder, entry, key, f"view {number}")
                # As it is found here: a name that was written on Windows may have backslashes.
                entry[key] = photo.relative_to(folder).as_posix()
                target = part / entry[key]
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(photo, target)
        (part / FILE).write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


def _badness(diagnosis: Diagnosis) -> tuple[int, ...]:
    """How much is red and how much yellow: less is better."""
    levels = [finding.level for finding in diagnosis.findings]
    return levels.count(Level.RED), levels.count(Level.YELLOW)


def _corrected(diagnosis: Diagnosis, capture: Capture) -> dict[str, Any]:
    """scene.json with the poses, intrinsics and file names of the mended capture."""
    data = copy.deepcopy(diagnosis.data)
    data["workspace"]["world_from_workspace"] = capture.views.workspace.world_from_workspace.tolist()
    written = diagnosis.data["views"]
    for i, (view, entry) in enumerate(zip(capture.views.frames, data["views"], strict=True)):
        entry["world_from_camera"] = view.camera.world_from_camera.tolist()
        entry["intrinsics"] = view.camera.intrinsics.tolist()
        entry["image"] = written[capture.images[i]]["image"]
        entry["background"] = written[capture.backgrounds[i]]["background"]
        if i in capture.exchanged:
            entry["image"], entry["background"] = entry["background"], entry["image"]
    return data
