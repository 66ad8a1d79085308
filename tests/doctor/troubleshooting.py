"""The page docs/troubleshooting.md, made from the doctor's own words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from neugrasp.doctor.findings import Finding, views_text
from neugrasp.doctor.messages import all_problems

FILE = Path(__file__).parents[2] / "docs/troubleshooting.md"
COMMAND = "UPDATE_DOCS=1 pytest -m slow tests/doctor/test_broken_captures.py"
HEAD = f"""# Troubleshooting

`neugrasp doctor SCENE` examines a capture and says for each item, with the measured value and what to do:
green, yellow (grasps will be worse), red (grasps fail), or grey: it could not be measured. Grey makes no
verdict worse, but is named in it where it matters: `green, but poses unchecked: too little texture on the
table`. `--report FILE.html` draws the cube and the table into every photo, `--fix OUT` writes a corrected
copy where the cause is certain and the copy is better. It ends with 1 on red alone.

`neugrasp predict` takes a quick look first, at what costs little and decides: conventions, units, intrinsics,
coverage, EXIF tags, backgrounds of other views or places or exchanged with images, photos in which nothing
is to be seen, light that changed much, and whether the photos agree about the table. It refuses on red unless
`--force` is given; with `--examine` everything is looked at.
[capture.md](capture.md#how-exact-poses-must-be) says where yellow and red lie.

This page is written by `{COMMAND}`; without the variable the
same test checks it.

## No grasps came out

`predict` says where all candidates went: `0 of 1,647: 1,610 beside a better one, 37 below 0.7 (best 0.41)`.
Without an evaluator (`--detector neugrasp`) every voxel is one: `0 of 64,000: 61,220 off the surface, 2,514
below 0.9 (best 0.83), 266 too wide for the gripper`.

| most of them | what it means |
|---|---|
| nothing stands on the table | no surface where objects stand, or no hand fits: run the doctor |
| off the surface | there is no surface where objects stand: see the report's surface, run the doctor |
| below the threshold, best near it | the network is unsure: more light, sharper photos, other views |
| below the threshold, best far from it | it does not understand the photos: run the doctor |
| too wide for the gripper | the objects are wider than the gripper opens: another `--gripper` |
| too narrow to be real | noise or the edge of the table was taken for objects |
| where the hand would touch something | objects stand close together: other views, a slimmer `--gripper` |
| where the fingers would hold a rim only, and others hold more | nothing: what is left holds better |
| with nothing between the fingers | the best places lie beside the surface: see the report's surface |
| beside a better one | nothing: of close neighbours only the best is kept |
| outside of the region | `--region` is a box in the world, in metres |
| outside of the mask | `--mask` is a picture of one photo, white where grasps are wanted |
| from another side than the approach asked for | a wider angle in `--approach`; 0 0 -1 is from above |
| lower than the least height | a smaller `--min-height`: from the table to between the fingertips |
| on another object than the best | nothing: `--one-object` keeps the grasps of one, then look again |
| beyond the best that were asked for | nothing: `--top` keeps so many |

## What the doctor can say

"""
TABLE = """## What it says to captures that were broken on purpose

One good capture (a ball and a box on a speckled table, four views), spoilt in one way at a time. The good one
is green, and so are the bundled demo scenes. The last column says where `--fix` brings back the good one.

| what was done | verdict | what the doctor says | what to do | `--fix` |
|---|---|---|---|---|
"""


def page(rows: Sequence[tuple[str, Finding, bool]]) -> str:
    """The whole page; rows hold what was done, the finding, and whether --fix mends it."""
    problems = [f"**{one.name}.** {one.meaning}\n*{one.remedy}.*\n\n" for one in all_problems()]
    return "".join([HEAD, *problems, TABLE, *(_row(*row) for row in rows)])


def _row(what: str, finding: Finding, is_mended: bool) -> str:
    assert finding.problem is not None
    where = f"{views_text(finding.views)}: " if finding.views else ""
    says = f"**{finding.problem.name}.** {finding.item}: {where}{finding.measured}"
    cells = (what, finding.level.word, says, finding.problem.remedy, "yes" if is_mended else "")
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def without_numbers(text: str) -> str:
    """Measured values differ in their last digits from machine to machine."""
    return re.sub(r"[-+]?\d+(\.\d+)?", "#", text)
