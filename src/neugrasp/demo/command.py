"""`neugrasp demo` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal


@dataclass(frozen=True, kw_only=True)
class Demo:
    """Predicts surfaces and grasps of the bundled scenes, with pictures. Runs on a CPU right after the
    installation."""

    doing: ClassVar[str] = "surfaces and grasps of four bundled scenes, some seconds each"

    out: Path = Path("outputs/demo")
    """Output folder; every scene gets a folder NAME/ in it."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""
    device: str = "cpu"
    """Device of PyTorch: cpu, cuda, cuda:1."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Precision of its products."""
