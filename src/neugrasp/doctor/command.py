"""`neugrasp doctor` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar


@dataclass(frozen=True)
class Doctor:
    """Checks a capture before anything is predicted: files, conventions, units, light, focus, what is seen.

    Prints a line for each item with the measured value and what to do: green, yellow (worse grasps), red
    (grasps fail) or grey (could not be measured). The exit code is 1 on red.
    """

    doing: ClassVar[str] = "looking at the photos, some seconds"

    scene: Path
    """A scene folder: scene.json, images/, backgrounds/."""
    report: Path | None = None
    """An HTML file to write, with the cube and the table drawn into every photo."""
    fix: Path | None = None
    """A new folder for a corrected copy; only faults whose cause is certain are corrected."""
