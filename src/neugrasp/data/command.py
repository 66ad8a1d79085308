"""`neugrasp pack` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from neugrasp.errors import InputError
from neugrasp.terminal import next_step


@dataclass(frozen=True)
class Pack:
    """Packs generated scenes into a few files of at most 60 MB, to be trained on elsewhere."""

    doing: ClassVar[str] = "packing the scenes"

    data: tuple[Path, ...]
    """Folders made by `neugrasp generate`."""
    out: Path
    """Where the shards and their index are written, all or none; `train --data` reads this folder."""
    quality: int | None = None
    """Quality of the photos, 1 to 100, as lossy WebP, with coarser grids and without depth and masks: 95
    takes a quarter of the bytes. By default everything is kept exactly."""
    targets: bool = True
    """Pack the views that losses compare with, too; geometry supervision needs none."""

    def run(self) -> str:
        """How many scenes are packed, and what to do next."""
        from neugrasp.data.shards import Shards, pack

        if self.quality is not None and not 1 <= self.quality <= 100:
            raise InputError(f"--quality {self.quality}; it must be 1 to 100")
        folders = [folder / "scenes" for folder in self.data]
        pack(folders, self.out, quality=self.quality, photos="all" if self.targets else "inputs")
        then = next_step("train", "--data", self.out, "--out", "runs/mine")
        return f"{len(Shards(self.out))} scenes in {self.out}\n{then}"
