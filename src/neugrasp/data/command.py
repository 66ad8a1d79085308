"""`neugrasp pack` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar


@dataclass(frozen=True)
class Pack:
    """Packs generated scenes into a few files of at most 60 MB, to be trained on elsewhere."""

    doing: ClassVar[str] = "packing the scenes"

    data: tuple[Path, ...]
    """Folders made by `neugrasp generate`."""
    out: Path
    """Folder for the shards and their index, all or none; `train --data` reads it."""
    quality: int | None = None
    """Store photos as lossy WebP of this quality, 1 to 100, with coarser grids and without depth and
    masks; 95 takes a quarter of the bytes. By default everything is kept exactly."""
    targets: bool = True
    """Pack the views that losses compare with, too; geometry supervision needs none."""
