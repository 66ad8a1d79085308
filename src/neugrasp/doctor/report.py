"""The diagnosis as one HTML file: findings, the cube and the table drawn into every photo, what differs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from neugrasp.doctor.convention import plausible
from neugrasp.doctor.examination import Diagnosis
from neugrasp.doctor.findings import Finding, Level, views_text
from neugrasp.doctor.light import different, drift_of
from neugrasp.doctor.table import table_colours
from neugrasp.doctor.table_crop import TableCrop, table_crops
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import Image, Views
from neugrasp.pictures.cube import draw_cube
from neugrasp.pictures.page import badge, marked, page, pictures, section, table, text

VERDICTS = {
    Level.GREEN: "Nothing to say against this capture.",
    Level.YELLOW: "This capture can be used; what is yellow makes the result worse.",
    Level.RED: "This capture cannot be used as it is; what is red comes first.",
}


def report(diagnosis: Diagnosis, name: str) -> str:
    """A whole HTML document."""
    sections = [section("Findings", findings_table(diagnosis.findings))]
    if diagnosis.capture is not None:
        views = diagnosis.capture.views
        note = "<p>Drawn as understood, with all certain mistakes undone.</p>" if diagnosis.is_mended else ""
        sections.append(section("The cube and the table in every photo", note, pictures(_drawn(views), 250)))
        if all(plausible(views, share=0.01)):
            crops = table_crops(views)
            sections.append(section("What differs from the empty table", pictures(_changes(crops), 250)))
            sections.append(
                section("The empty table from above, as each view has it", *_tables(crops, views))
            )
    return page(f"Capture {name}: {diagnosis.verdict}", VERDICTS[diagnosis.level], sections)


def findings_table(findings: Sequence[Finding]) -> str:
    """All findings, the worst first."""
    rows = []
    for finding in sorted(findings, key=lambda finding: -finding.level):
        where = f"{views_text(finding.views)}: " if finding.views else ""
        what = text(where + finding.measured)
        if finding.problem:
            what += f'<div class="remedy"><b>{marked(finding.problem.remedy)}.</b></div>'
            what += f'<div class="meaning">{marked(finding.problem.meaning)}</div>'
        rows.append((badge(finding.level.word, finding.level.word), text(finding.item), what))
    return table(("", "item", "measured, and what to do"), rows)


def _drawn(views: Views) -> list[tuple[Image, str]]:
    figures = []
    for i, view in enumerate(views.frames):
        for photo, what in ((view.image, "image"), (view.background, "background")):
            figures.append((draw_cube(photo, view.camera, views.workspace), f"view {i}, {what}"))
    return figures


def _changes(crops: Sequence[TableCrop]) -> list[tuple[Image, str]]:
    """The image in grey with what is new in it in red; the outline of the cube stays bright."""
    figures = []
    for crop in crops:
        mask = different(crop, drift_of(crop))
        grey = crop.image.mean(axis=-1, keepdims=True).repeat(3, axis=-1)
        picture = np.where(crop.inside[..., None], grey, 0.55 * grey)
        picture = np.where(mask[..., None], 0.45 * picture + 0.55 * np.array([0.95, 0.15, 0.1]), picture)
        figures.append(((picture * 255).round().astype(np.uint8), f"view {crop.index}: red differs"))
    return figures


def _tables(crops: Sequence[TableCrop], views: Views) -> list[str]:
    workspace: Workspace = views.workspace
    figures = [(table_colours(crop, workspace), f"view {crop.index}") for crop in crops]
    return [
        "<p>All of them must show the same, at the same place.</p>",
        pictures(figures, width=220),
    ]
