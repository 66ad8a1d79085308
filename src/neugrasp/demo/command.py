"""`neugrasp demo` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal


@dataclass(frozen=True, kw_only=True)
class Demo:
    """Bundled scenes in, surfaces, grasps and pictures out. Runs on a CPU right after the installation."""

    doing: ClassVar[str] = "surfaces and grasps of four bundled scenes, some seconds each"

    out: Path = Path("outputs/demo")
    """Where NAME/ is written for every scene."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""
    device: str = "cpu"
    """Where PyTorch computes: cpu, cuda, cuda:1."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of its products."""
