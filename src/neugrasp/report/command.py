"""`neugrasp predict` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

from neugrasp.detection.options import Steering


@dataclass(frozen=True, kw_only=True)
class Predict:
    """Photos of a scene in; grasps.json, surface.ply, tsdf.npz and overlay.png out. The doctor takes a quick
    look first; on red nothing is predicted."""

    doing: ClassVar[str] = "looking at the photos, then predicting, some seconds"

    scene: Path
    """A scene folder: scene.json, images/, backgrounds/ (docs/data_format.md)."""
    out: Path = Path("outputs/prediction")
    """Where the files are written: all of them or none."""
    detector: str = "neugrasp"
    """One that takes photos: a name, or package.module:NAME (docs/benchmark.md)."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""
    threshold: float | None = None
    """Score from which a grasp is one; by default the one that the weights were judged with."""
    report: bool = False
    """Write report.html, too: the scene to turn, why candidates fell out, the doctor's verdict."""
    hand_check: bool = True
    """Send grasps as deep as the surface lets the hand, and drop those that it speaks against."""
    evaluator: str = "neugrasp"
    """A bundled evaluator of grasps, or a file: what `--detector neugrasp-evaluator` asks."""
    steering: Steering = field(default_factory=Steering)
    device: str = "cpu"
    """Where PyTorch computes: cpu, cuda, cuda:1."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of its products."""
    examine: bool = False
    """Let the doctor look at everything first, as `neugrasp doctor` does."""
    force: bool = False
    """Predict even where the doctor says red."""
    server: str | None = None
    """The address of a `neugrasp serve` that predicts in place of this machine, with its own weights and
    gripper: http://HOST:8421."""
    token_file: Path | None = None
    """A file with the token that the server asks for."""
