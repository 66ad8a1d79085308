"""`neugrasp predict` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

from neugrasp.detection.options import Steering


@dataclass(frozen=True, kw_only=True)
class Predict:
    """Predicts grasps from the photos of a scene: grasps.json, surface.ply, tsdf.npz and overlay.png. The
    doctor takes a quick look first; on red nothing is predicted."""

    doing: ClassVar[str] = "looking at the photos, then predicting, some seconds"

    scene: Path
    """A scene folder: scene.json, images/, backgrounds/ (docs/data_format.md)."""
    out: Path = Path("outputs/prediction")
    """Output folder; all files are written, or none."""
    detector: str = "auto"
    """A detector that takes photos: its name, or package.module:NAME (docs/benchmark.md). auto: the network,
    whose grasps an evaluator judges if one knows the weights; else its head (neugrasp)."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""
    threshold: float | None = None
    """Minimum score of a grasp; by default the one stored with the evaluator, or with the weights."""
    report: bool = False
    """Also write report.html: the scene in 3D, why candidates were rejected, the doctor's verdict."""
    hand_check: bool = True
    """Without an evaluator: push each grasp as deep as the surface allows, and drop grasps that would
    collide or close on nothing."""
    evaluator: str = "neugrasp"
    """The evaluator that judges grasps: a bundled name, or a file."""
    steering: Steering = field(default_factory=Steering)
    device: str = "cpu"
    """Device of PyTorch: cpu, cuda, cuda:1."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Precision of its products."""
    examine: bool = False
    """Run the whole `neugrasp doctor` first."""
    force: bool = False
    """Predict even if the doctor says red."""
    server: str | None = None
    """The address of a `neugrasp serve` that predicts in place of this machine, with its own weights and
    gripper: http://HOST:8421."""
    token_file: Path | None = None
    """A file with the token that the server asks for."""
