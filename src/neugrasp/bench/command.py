"""`neugrasp bench` as plain data; heavy parts load when it is run."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar, Literal


@dataclass(frozen=True, kw_only=True)
class SpeedTest:
    """Speed of every stage on this machine: of detecting and of training, beside its roofline."""

    doing: ClassVar[str] = "measuring, some minutes"

    json: Path | None = None
    """A file for all figures."""
    network: Literal["small", "paper"] = "small"
    """small: the shipped network and its recipe. paper: the paper's shapes at random weights."""
    part: Literal["all", "inference", "training"] = "all"
    """What is measured."""
    detectors: bool = False
    """Instead, seconds from photos or depth to grasps of every detector that is registered here."""
    only: tuple[str, ...] = ()
    """With --detectors: these, by name or as package.module:NAME."""
    weights: tuple[str, ...] = ()
    """With --detectors: those that should not be a detector's own, as NAME=FILE: vgn=vgn_conv.pth."""
    restorer: str = "swindr"
    """With --detectors: bundled weights that restore depth, or a file: what swindr-vgn asks before VGN."""
    views: int = 4
    """Photos of the scene, 1 to 8."""
    rounds: int = 5
    """How often everything is timed; of training steps, which are slow, half as often."""
    threads: int | None = None
    """Threads that PyTorch computes with; by default as many as it takes by itself."""
    device: str = "cpu"
    """Where to compute."""
    precision: Literal["own", "float32", "bfloat16"] = "own"
    """Of the products: what the detector and the recipe choose themselves, or one of these."""
    seed: int = 0
    """Of random weights, rays and grasps."""

    def command(self) -> str:
        """The line that repeats this run."""
        words = ["neugrasp", "bench"]
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "json" or value == field.default:
                continue
            if isinstance(value, bool):
                words.append(f"--{field.name}" if value else f"--no-{field.name}")
            elif isinstance(value, tuple):
                words += [f"--{field.name}", *map(str, value)]
            else:
                words += [f"--{field.name}", str(value)]
        return shlex.join(words)
