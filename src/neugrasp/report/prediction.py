"""A prediction as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from neugrasp.detection.contract import Detection
from neugrasp.detection.explanation import explain, reasons_of
from neugrasp.doctor.examination import Diagnosis
from neugrasp.doctor.findings import Level
from neugrasp.doctor.report import findings_table
from neugrasp.grasp import Grasp
from neugrasp.observation import Image, Views
from neugrasp.pictures import draw_grasps, photo_of_workspace, score_legend, shade_surface, slice_picture
from neugrasp.pictures.page import badge, data_uri, page, pictures, section, table, text
from neugrasp.report.scene_3d import scene_3d

DRAWN = 5
"""Grasps drawn into a photo; more hide the objects."""
LISTED = 30
"""Rows of the table of grasps."""


def prediction_report(name: str, views: Views, detection: Detection, diagnosis: Diagnosis) -> str:
    """A whole HTML page: pictures, the scene to turn, grasps, rejected candidates, timings, the doctor."""
    gripper = detection.gripper
    if detection.grasps:
        count, best = len(detection.grasps), detection.grasps[0].score
        lead = f"{count} grasps for the {gripper.name} gripper, the best with score {best:.2f}. "
    else:
        lead = "No grasps. "
    lead += f"Candidates: {explain(detection)}."
    grasps = detection.grasps
    sections = [section("Photos with the best grasps", pictures(_photos(views, detection), 420), _legend())]
    if detection.tsdf is not None:
        scene = scene_3d(views, detection.tsdf, grasps, gripper)
        sections.append(section("Surface, cameras and grasps", scene))
    sections += [
        section("Grasps, best first", _grasp_table(grasps)),
        section("Rejected candidates", _reason_table(detection)),
    ]
    if detection.tsdf is not None:
        surfaces = pictures(_surfaces(views, detection.tsdf))
        sections.append(section("The surface as the cameras see it", surfaces))
    sections += [
        section("Seconds", _timings(detection)),
        section("The doctor's verdict on the capture", _verdict(diagnosis)),
    ]
    return page(f"Prediction for {name}", lead, sections)


def _legend() -> str:
    return f'<p><img alt="colours of scores from 0.5 to 1" src="{data_uri(score_legend())}"></p>'


def _photos(views: Views, detection: Detection) -> list[tuple[Image, str]]:
    best = detection.grasps[:DRAWN]
    crops = [photo_of_workspace(view, views.workspace, 640) for view in views.frames]
    what = f"the {len(best)} best grasps, 1 the best" if best else "no grasps"
    return [
        (draw_grasps(crop, best, detection.gripper, 1), f"view {i}: {what}") for i, crop in enumerate(crops)
    ]


def _surfaces(views: Views, tsdf: NDArray[np.float32]) -> list[tuple[Image, str]]:
    crops = [photo_of_workspace(view, views.workspace) for view in views.frames]
    figures = [
        (shade_surface(tsdf, views.workspace, crop.camera, 400), f"view {i}") for i, crop in enumerate(crops)
    ]
    return [*figures, (slice_picture(tsdf, views.workspace), "a cut through the distances")]


def _grasp_table(grasps: Sequence[Grasp]) -> str:
    rows = [
        (
            str(number),
            f"{grasp.score:.3f}",
            f"{grasp.width * 1000:.0f}",
            " ".join(f"{x:+.4f}" for x in grasp.position),
            " ".join(f"{x:+.2f}" for x in grasp.approach),
        )
        for number, grasp in enumerate(grasps[:LISTED], 1)
    ]
    head = ("number", "score", "width [mm]", "TCP in the world [m]", "approach")
    more = len(grasps) - len(rows)
    note = f"<p>{more} more in grasps.json.</p>" if more > 0 else ""
    return f'<div id="grasps">{table(head, rows, numeric=(0, 1, 2))}</div>{note}' if rows else "<p>None.</p>"


def _reason_table(detection: Detection) -> str:
    rows = [(text(words), f"{count:,}") for words, count in reasons_of(detection)]
    rows.append(("kept", f"{len(detection.grasps):,}"))
    return table(("reason", "candidates"), rows, numeric=(1,))


def _timings(detection: Detection) -> str:
    stages = detection.timing_s
    rows = [(text(stage.replace("_", " ")), f"{seconds:.2f}") for stage, seconds in stages.items()]
    rows.append(("<b>all</b>", f"<b>{sum(stages.values()):.2f}</b>"))
    return table(("stage", "seconds"), rows, numeric=(1,))


def _verdict(diagnosis: Diagnosis) -> str:
    bad = [finding for finding in diagnosis.findings if finding.level > Level.GREEN]
    verdict = badge(diagnosis.level.word, diagnosis.level.word)
    fine = sum(finding.level == Level.GREEN for finding in diagnosis.findings)
    good = f"<p>{verdict} {fine} items are green.</p>"
    return good + (findings_table(bad) if bad else "")
