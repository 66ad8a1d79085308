"""`neugrasp figure` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

DEFAULT_SCENE = "packed_transparent"


@dataclass(frozen=True)
class Figure:
    """Draws a figure of the paper from a model and photos of your own (docs/figures.md).

    features: what the network sees in a photo, before and after it heeds the background (Fig. 4).
    priors: surface and grasps with and without photos of the empty table (Fig. 5).
    trajectory: from where the photos are taken, and the way of the hand to the best grasp and back.
    """

    doing: ClassVar[str] = "drawing, up to a minute"

    which: Literal["features", "priors", "trajectory"]
    """The figure to draw."""
    out: Path | None = None
    """The PNG file to write; by default outputs/figures/WHICH.png."""
    scene: str = DEFAULT_SCENE
    """A scene folder, or the name of a bundled scene."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    without: str | None = None
    """For priors: weights of a model trained without backgrounds. By default the model of --weights is
    shown without its photos of the empty table."""
    gripper: str = "panda"
    """The gripper to draw: a name of a bundled one, or a file."""
    view: int = 0
    """The photo to draw, from 0."""
    seed: int = 0
    """For features: chooses the pixels that are embedded."""
    device: str = "cpu"
    """Device of PyTorch: cpu, cuda, cuda:1."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Precision of its products."""
