"""A detection as a notebook shows it."""

from __future__ import annotations

import html

from neugrasp.detection.explanation import Told, explain

LISTED = 10
"""Grasps in the table."""


def in_short(detection: Told) -> str:
    """One line."""
    grasps, seconds = detection.grasps, sum(detection.timing_s.values())
    best = f", the best with score {grasps[0].score:.2f}" if grasps else ""
    return f"Detection({len(grasps)} grasps{best}; {seconds:.1f} s)"


def as_html(detection: Told) -> str:
    """A table of the best grasps, numbered from 1 as everywhere, and where the other candidates went."""
    head = "<tr><th>grasp</th><th>score</th><th>width [mm]</th><th>TCP [m]</th><th>approach</th></tr>"
    rows = [
        f"<tr><td>{number}</td><td>{grasp.score:.3f}</td><td>{1000 * grasp.width:.0f}</td>"
        f"<td>{' '.join(f'{x:+.3f}' for x in grasp.position)}</td>"
        f"<td>{' '.join(f'{x:+.2f}' for x in grasp.approach)}</td></tr>"
        for number, grasp in enumerate(detection.grasps[:LISTED], 1)
    ]
    more = len(detection.grasps) - len(rows)
    rest = f"<p>{more} more.</p>" if more > 0 else ""
    table = f"<table>{head}{''.join(rows)}</table>" if rows else ""
    return f"{table}{rest}<p>Candidates: {html.escape(explain(detection))}.</p>"
