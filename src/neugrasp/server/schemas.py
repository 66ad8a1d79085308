"""The shapes of answers, for the description at /openapi.json and for those who generate clients.

Answers are made from plain data (`answers.py`); a test holds them against these.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from neugrasp.detection.contract import Detection
from neugrasp.geometry.pose import rigid
from neugrasp.geometry.workspace import USUAL
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper

Row3 = tuple[float, float, float]
Row4 = tuple[float, float, float, float]


class GraspModel(BaseModel):
    """A parallel-jaw grasp in the world of the scene: z approaches, y closes the fingers."""

    position: Row3 = Field(description="The TCP between the pads, metres.")
    quaternion_xyzw: Row4
    width: float = Field(description="Between the pads when they touch, metres.")
    score: float = Field(description="Predicted quality, 0 to 1: higher is better, no probability.")
    pregrasp_position: Row3
    retreat_position: Row3


class DetectionModel(BaseModel):
    """The content of grasps.json (docs/data_format.md)."""

    model_config = ConfigDict(extra="allow")

    format: Literal["neugrasp-grasps"]
    version: int
    frame: Literal["world"]
    up: Row3 | None = Field(None, description="Unit vector away from the table.")
    grasps: list[GraspModel] = Field(description="Best first.")
    scene: str | None = None
    gripper: str
    rejected: dict[str, int] = Field(description="Candidates rejected, by rule.")
    timing_s: dict[str, float]
    workspace: dict[str, Any]
    gripper_file: dict[str, Any]
    best_rejected: float | None = None
    threshold: float | None = None
    margin: float | None = Field(
        None, description="How much less sure than the best a grasp may be that is carried out."
    )
    tsdf: str | None = Field(
        None, description="With ?tsdf=true: base64 of zlib of float32, little endian, indexed [x, y, z]."
    )


class FindingModel(BaseModel):
    """One thing that the doctor noticed."""

    item: str
    level: Literal["grey", "yellow", "red"]
    measured: str
    remedy: str
    views: list[int]


class VerdictModel(BaseModel):
    """The doctor's word on the capture."""

    level: Literal["green", "yellow", "red"]
    verdict: str
    findings: list[FindingModel]


class SurfaceModel(BaseModel):
    """The mesh, metres, in the world of the scene."""

    format: Literal["glb", "ply"]
    base64: str


class AnswerModel(BaseModel):
    """A detection with what else was asked for."""

    request: str = Field(description="As in the header X-Request-ID and in the server's log.")
    detection: DetectionModel
    doctor: VerdictModel
    seconds: dict[str, float] = Field(description="Of the server's stages; the detector's are in timing_s.")
    surface: SurfaceModel | None = None


class ProblemModel(BaseModel):
    """An answer that is none (RFC 9457)."""

    status: int
    detail: str = Field(description="What is wrong, and what would be right.")
    request: str
    doctor: VerdictModel | None = None


class CellModel(BaseModel):
    """A cell that is kept."""

    cell: str
    views: int
    sizes: list[tuple[int, int]] = Field(description="Width and height of its photos, by view.")
    workspace: dict[str, Any]


class WeightsModel(BaseModel):
    """What the server answers with."""

    model_config = ConfigDict(extra="allow")

    detector: str
    gripper: str
    devices: list[str]
    precision: str
    version: str


def example_answer() -> dict[str, Any]:
    """An answer with one grasp, from straight above the middle of the cube."""
    pose = rigid(np.diag([1.0, -1.0, -1.0]), USUAL.centre)
    grasp = Grasp(pose, width=0.04, score=0.93)
    detection = Detection(
        Grasps.of([grasp]), USUAL, Gripper.load("panda"), None, {"not_the_best_nearby": 11}, None, 0.9
    )
    doctor = {"level": "green", "verdict": "green", "findings": []}
    return {"request": "example", "detection": detection.to_dict(), "doctor": doctor, "seconds": {}}


def example_problem(status: int, detail: str) -> dict[str, Any]:
    """An answer that is none."""
    return {"status": status, "detail": detail, "request": "example"}
