"""What the files of photos say of themselves (EXIF) against what scene.json says of the camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.photo_files import OTHER_FOCAL, Tags, photo_tags
from neugrasp.data.scene_folder import photo_of
from neugrasp.doctor.findings import Finding, Level, green
from neugrasp.doctor.messages import OTHER_LENS, ROTATION_TAG
from neugrasp.geometry.camera import Camera
from neugrasp.observation import View

SAME_FOCAL = 1.1
"""Factor between the photos of one camera; a phone's lenses are further apart."""


@dataclass(frozen=True)
class Told:
    """What a photo says of itself, and the camera that is said to have taken it."""

    name: str
    tags: Tags
    camera: Camera


def check_tags(folder: Path, entries: Sequence[Any], views: Sequence[View]) -> list[Finding]:
    """Findings on the readable views of a scene and their entries in scene.json: photos that are to be
    shown turned or mirrored, and those taken with another focal length than the intrinsics have."""
    told = []
    for number, (entry, view) in enumerate(zip(entries, views, strict=True)):
        for key in ("image", "background"):
            where = f"view {number}"
            tags = photo_tags(photo_of(folder, entry, key, where), where)
            told.append(Told(entry[key], tags, view.camera))
    return findings_of(told)


def findings_of(photos: Sequence[Told]) -> list[Finding]:
    """The same of photos whose tags were read."""
    turned: list[str] = []
    factors: dict[str, float] = {}
    lengths: dict[str, float] = {}
    for photo in photos:
        name, tags, camera = photo.name, photo.tags, photo.camera
        if tags.lies is not None:
            turned.append(f"{name} is stored {tags.lies}")
        if tags.focal_pixels is not None and camera.sensed is None:
            factors[name] = tags.focal_pixels / camera.intrinsics[0, 0]
            lengths[name] = tags.focal_35mm or 0.0
    findings = []
    if turned:
        text = f"EXIF orientation is not 1: {', '.join(turned)}"
        findings.append(Finding("rotation tag", Level.YELLOW, text, ROTATION_TAG))
    return [*findings, *_other_lens(factors, lengths)]


def _other_lens(factors: dict[str, float], lengths: dict[str, float]) -> list[Finding]:
    if not factors:
        return []
    farthest = max(factors, key=lambda name: abs(np.log(factors[name])))
    if not 1 / OTHER_FOCAL <= factors[farthest] <= OTHER_FOCAL:
        text = (
            f"{farthest} was taken at {lengths[farthest]:g} mm (of 35 mm film), {factors[farthest]:.2f} "
            "times the focal length in scene.json"
        )
        return [Finding("focal length", Level.YELLOW, text, OTHER_LENS)]
    low, high = (end(factors, key=lambda name: factors[name]) for end in (min, max))
    if factors[high] > SAME_FOCAL * factors[low]:
        text = (
            f"{low} was taken at {lengths[low]:g} mm (of 35 mm film), {high} at {lengths[high]:g} mm; the "
            "focal lengths in scene.json are not as far apart"
        )
        return [Finding("focal length", Level.YELLOW, text, OTHER_LENS)]
    return [green("focal length", f"{factors[farthest]:.2f} times that of scene.json by EXIF tags, at most")]
