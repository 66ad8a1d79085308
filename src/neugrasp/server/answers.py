"""What comes back: a detection, the doctor's word, and the surface as a file if it is asked for."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from neugrasp.detection.contract import Detection
from neugrasp.detection.files import write_surface
from neugrasp.doctor.examination import Diagnosis
from neugrasp.doctor.findings import Level
from neugrasp.viewer.glb import glb

SurfaceFile = Literal["none", "glb", "ply"]
GREY = (176, 178, 184)
"""Colour of a surface in a GLB file."""


@dataclass(frozen=True)
class Wanted:
    """What an answer holds besides the grasps."""

    surface: SurfaceFile = "none"
    tsdf: bool = False
    force: bool = False
    """An answer even where the doctor says red."""


def answer_of(
    detection: Detection, diagnosis: Diagnosis, wanted: Wanted, seconds: Mapping[str, float], request: str
) -> dict[str, Any]:
    """The answer as plain data; `seconds` are those of the server's stages, around the detector's own.

    Raises `InputError` where a surface is wanted of a detector without one.
    """
    content: dict[str, Any] = {
        "request": request,
        "detection": detection.to_dict(with_surface=wanted.tsdf),
        "doctor": verdict_of(diagnosis),
        "seconds": {stage: round(spent, 6) for stage, spent in seconds.items()},
    }
    if wanted.surface != "none":
        file = base64.b64encode(surface_file(detection, wanted.surface)).decode("ascii")
        content["surface"] = {"format": wanted.surface, "base64": file}
    return content


def verdict_of(diagnosis: Diagnosis) -> dict[str, Any]:
    """The doctor's word on the capture, as plain data: what is not green, with what to do."""
    findings = [
        {
            "item": finding.item,
            "level": finding.level.word,
            "measured": finding.measured,
            "remedy": finding.problem.remedy if finding.problem else "",
            "views": list(finding.views),
        }
        for finding in diagnosis.findings
        if finding.level > Level.GREEN
    ]
    return {"level": diagnosis.level.word, "verdict": diagnosis.verdict, "findings": findings}


def surface_file(detection: Detection, kind: SurfaceFile) -> bytes:
    """The mesh in the world of the scene, metres, z as there. Raises `InputError` without a surface."""
    surface = detection.surface()
    if kind == "glb":
        return glb(surface, np.tile(np.array(GREY, dtype=np.uint8), (len(surface.vertices), 1)))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "surface.ply"
        write_surface(file, surface)
        return file.read_bytes()
