"""What is wrong with poses that do not fit: the common mistakes in the file that the user has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from neugrasp.data.camera_checks import is_plausible
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array
from neugrasp.geometry.workspace import Workspace
from neugrasp.importers.alignment import align
from neugrasp.importers.shots import Shot


def check_poses(shots: Sequence[Shot], workspace: Workspace, where: str) -> None:
    """Raises `InputError` where most cameras do not look down at the cube, and would if one of the common
    mistakes had been made; where no mistake is known, what is said of the scene later has to do."""
    cameras = [Camera(s.lens.intrinsics, s.world_from_camera, s.lens.width, s.lens.height) for s in shots]
    if sum(is_plausible(camera, workspace) for camera in cameras) > len(cameras) / 2:
        return
    causes = [
        mistake
        for mistake in _common(shots)
        if all(
            is_plausible(replace(camera, world_from_camera=shot.suspects[mistake]), workspace)
            for camera, shot in zip(cameras, shots, strict=True)
        )
    ]
    if causes:
        raise InputError(f"{where}: the cameras do not look down at the workspace; {'; or: '.join(causes)}")


def explained(error: str, shots: Sequence[Shot], world_from_camera: Sequence[Array], has_unit: bool) -> str:
    """The error of an alignment with the mistake, undone, that makes it fit."""
    for mistake in _common(shots):
        try:
            align([shot.suspects[mistake] for shot in shots], world_from_camera, has_unit)
        except InputError:
            continue
        return f"{error} {mistake[0].upper()}{mistake[1:]}"
    return error


def _common(shots: Sequence[Shot]) -> list[str]:
    """The mistakes that all of the shots could have."""
    first = list(shots[0].suspects) if shots else []
    return [mistake for mistake in first if all(mistake in shot.suspects for shot in shots)]
