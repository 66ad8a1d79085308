"""A cell clears its table: look, detect, choose, plan, pick, drop.

    python examples/12_clear_a_table.py --cell examples/cells/twin.toml --detector oracle

The cell of this file is simulated: a UR5e with a 2F-85 that has to reach what it grasps. With the file of a
real cell, and a detector that sees photos, the same lines drive a UR arm (docs/robot.md says what was tried).
`--dry-run` moves nothing. The same as a command: `neugrasp run`. Needs `pip install 'neugrasp[sim,robot]'`,
and `render` for photos.
"""

from __future__ import annotations

from pathlib import Path

import tyro

from neugrasp.operation.check import findings_of
from neugrasp.operation.command import Run
from neugrasp.operation.run import run
from neugrasp.robot.cell_file import read_cell


def main(
    cell: Path = Path(__file__).parent / "cells/twin.toml",
    detector: str = "oracle",
    out: Path = Path("outputs/cleared"),
    dry_run: bool = False,
    photos: Path | None = None,
) -> None:
    """Says what is wrong with the cell, then clears its table, or prints what it would do."""
    for finding in findings_of(read_cell(cell)):
        print(finding)
    print(run(Run(cell, out, detector=detector, dry_run=dry_run, photos=photos)))


if __name__ == "__main__":
    tyro.cli(main)
