"""What a path is, and its contents."""

from __future__ import annotations

import re

from neugrasp.data.scene_folder import FILE
from neugrasp.errors import InputError
from neugrasp.viewer.command import Viewer
from neugrasp.viewer.contents import Contents
from neugrasp.viewer.reading import GRASPS, Choices, prediction_contents, scene_contents
from neugrasp.viewer.rounds import round_contents


def open_contents(viewer: Viewer) -> Contents:
    """Whatever lies at the path. Raises `InputError` where it is nothing that can be shown."""
    path = viewer.path
    choices = Choices(viewer.scene, viewer.gripper, viewer.objects)
    if path.is_file() and path.name == GRASPS:
        path = path.parent
    if (path / GRASPS).is_file():
        return prediction_contents(path, choices)
    if path.name == FILE or (path / FILE).is_file():
        return scene_contents(path, choices)
    if (path / "run.json").is_file() and (path / "rounds").is_dir():
        return round_contents(path, viewer.round, choices)
    if path.is_file() and path.parent.name == "rounds" and re.fullmatch(r"\d{6}\.json", path.name):
        return round_contents(path.parent.parent, int(path.stem), choices)
    raise InputError(
        f"{path}: nothing to show; give a scene (a folder with {FILE}), a prediction (with {GRASPS}), or "
        "an evaluation (a folder with run.json and rounds/)"
    )
