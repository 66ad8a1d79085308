"""`neugrasp view` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal


@dataclass(frozen=True)
class Viewer:
    """Shows a capture, a prediction or a round of decluttering in the browser, in 3D.

    Needs the extra `view`: pip install 'neugrasp[view]'.
    """

    doing: ClassVar[str] = "reading what is to be seen"

    path: Path
    """A scene folder, what `neugrasp predict` or `demo` wrote, or what `neugrasp evaluate` wrote."""
    scene: Path | None = None
    """The scene of a prediction; by default the one that it names."""
    round: int = 0
    """Round of an evaluation, counted from 0."""
    objects: Path | None = None
    """The folder of URDF objects that an evaluation or a record was made with."""
    gripper: str | None = None
    """The gripper to draw: a name of a bundled one, or a file; by default the one that was used."""
    screenshot: Path | None = None
    """Write one picture to this PNG file, with a browser without a window, and end."""
    size: tuple[int, int] = (1280, 960)
    """Width and height of the picture, pixels."""
    panel: bool = False
    """Take the picture of the page with its controls, not of the scene alone."""
    colour: Literal["photos", "confidence", "views", "plain"] = "photos"
    """How the surface is coloured."""
    grasps: int = 5
    """Number of grasps drawn at first, the best ones."""
    hand: Literal["fingers", "whole", "lines"] = "fingers"
    """How the gripper is drawn at first."""
    truth: bool = False
    """Show the ground truth at first, where there is one."""
    moment: int = 0
    """Moment of a round to show first, counted from 0."""
    browser: str | None = None
    """The Chromium or Chrome to take pictures with; by default the first one found."""
    host: str = "127.0.0.1"
    """Address to listen on; 0.0.0.0 lets other machines look, too."""
    port: int | None = None
    """Port to listen on, from 1024 to 65535; 0 takes any free one. By default the first free one from 8080
    on."""
