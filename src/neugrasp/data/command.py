"""`neugrasp pack` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Pack:
    """Packs generated scenes into a few files of at most 60 MB, to be trained on elsewhere."""

    data: tuple[Path, ...]
    """Folders made by `neugrasp generate`."""
    out: Path
    """Where the shards and their index are written, all or none; `train --data` reads this folder."""

    def run(self) -> str:
        """How many scenes are packed."""
        from neugrasp.data.shards import Shards, pack

        pack([folder / "scenes" for folder in self.data], self.out)
        return f"{len(Shards(self.out))} scenes in {self.out}"
