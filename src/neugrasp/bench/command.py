"""`neugrasp bench` as plain data; heavy parts load when it is run."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar, Literal


@dataclass(frozen=True, kw_only=True)
class SpeedTest:
    """Times every stage of detection and training on this machine, beside its roofline."""

    doing: ClassVar[str] = "measuring, some minutes"

    json: Path | None = None
    """A file for all figures."""
    network: Literal["small", "paper"] = "small"
    """small: the shipped network and its recipe. paper: the paper's shapes at random weights."""
    part: Literal["all", "inference", "training"] = "all"
    """Part to measure."""
    detectors: bool = False
    """Instead, time every registered detector, from photos or depth to grasps."""
    only: tuple[str, ...] = ()
    """With --detectors: the detectors to time, by name or as package.module:NAME."""
    weights: tuple[str, ...] = ()
    """With --detectors: other weights for detectors, as NAME=FILE: vgn=vgn_conv.pth."""
    restorer: str = "swindr"
    """With --detectors: the weights with which swindr-vgn restores depth: a bundled name, or a file."""
    views: int = 4
    """Number of photos of the scene, 1 to 8."""
    rounds: int = 5
    """Number of timings; training steps, which are slow, are timed half as often."""
    threads: int | None = None
    """Number of threads of PyTorch; by default its own choice."""
    device: str = "cpu"
    """Device: cpu, cuda, cuda:1."""
    precision: Literal["own", "float32", "bfloat16"] = "own"
    """Precision of products; own: what the detector and the recipe choose."""
    seed: int = 0
    """Seed of random weights, rays and grasps."""

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
