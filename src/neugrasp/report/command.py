"""`neugrasp datasheet` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from neugrasp.terminal import next_step


@dataclass(frozen=True)
class DataSheet:
    """Describes generated scenes: counts, balance of labels and materials, pictures."""

    doing: ClassVar[str] = "reading the scenes"

    data: tuple[Path, ...]
    """Folders made by `neugrasp generate`, or of shards packed from them; each has a column."""
    out: Path
    """Where data_sheet.md and its two pictures are written, all or none."""

    def run(self) -> str:
        """The sheet's name, and what to do next."""
        from neugrasp.report.data_sheet import write_data_sheet

        sheet = write_data_sheet(self.data, self.out)
        return f"{sheet}\n{next_step('train', '--data', *self.data, '--out', 'runs/mine')}"
