"""`neugrasp datasheet` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class DataSheet:
    """Describes generated scenes: counts, balance of labels and materials, pictures."""

    data: tuple[Path, ...]
    """Folders made by `neugrasp generate`, or of shards packed from them; each has a column."""
    out: Path
    """Where data_sheet.md and its two pictures are written, all or none."""

    def run(self) -> Path:
        """The sheet's name."""
        from neugrasp.report.data_sheet import write_data_sheet

        return write_data_sheet(self.data, self.out)
