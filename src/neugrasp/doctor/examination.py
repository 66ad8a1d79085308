"""The whole examination of a capture, in the order in which one mistake hides the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from neugrasp.doctor.camera_findings import check_coverage, check_intrinsics
from neugrasp.doctor.capture import Capture, Reading, read_capture, tags_of
from neugrasp.doctor.convention import check_convention, is_examinable
from neugrasp.doctor.empty_table import check_empty_table
from neugrasp.doctor.findings import Finding, Level, verdict, worst
from neugrasp.doctor.light_checks import check_brightness, check_light, check_sharpness
from neugrasp.doctor.messages import BACKGROUND_DIFFERS, MIRRORED, SAME_PHOTO, SHIFTED, TABLE_HEIGHT
from neugrasp.doctor.pair_checks import check_exchanged_quickly, check_pairs, check_pairs_quickly
from neugrasp.doctor.silhouettes import check_silhouettes
from neugrasp.doctor.table import TablePicture, coarse_pictures
from neugrasp.doctor.table_checks import check_scale, check_table, check_table_quickly
from neugrasp.doctor.table_crop import GLANCE_SIZE, table_crops
from neugrasp.observation import Views

Look = Callable[[Capture], tuple[Capture, list[Finding]]]
"""Checks of cameras that look at the cube, and the capture with certain mistakes undone."""
MISPLACED = (BACKGROUND_DIFFERS, MIRRORED, SHIFTED)
"""Where a background was not taken by the camera of its view."""
UNPAIRED = (BACKGROUND_DIFFERS, MIRRORED)
"""Where image and background cannot be laid over each other, nothing else can be said of the two."""


@dataclass(frozen=True)
class Diagnosis:
    """What the doctor found, and the capture with every certain mistake undone."""

    findings: tuple[Finding, ...]
    capture: Capture | None
    """None where nothing could be read."""
    data: dict[str, Any]
    """The content of scene.json; empty for a scene in memory."""
    is_mended: bool
    """Whether `capture` differs from what was written down."""

    @property
    def level(self) -> Level:
        """The worst of all findings."""
        return worst(self.findings)

    @property
    def verdict(self) -> str:
        """The level in words, with what could not be measured and matters."""
        return verdict(self.findings)

    def lines(self, least: Level = Level.GREEN) -> list[str]:
        """The findings of at least this level as text, in order."""
        return [finding.line() for finding in self.findings if finding.level >= least]


def examine_folder(path: Path) -> Diagnosis:
    """The diagnosis of a scene on disk; never raises for what a user may have done to it."""
    return _examine(read_capture(path))


def examine(capture: Capture) -> Diagnosis:
    """The diagnosis of a scene in memory."""
    return _examine(Reading(capture, ()))


def examine_read(
    views: Views,
    thoroughly: bool = False,
    tags: Sequence[Finding] | None = None,
    table: KnownTable | None = None,
) -> Diagnosis:
    """The diagnosis of a scene as `read_scene` gave it, with what its files say: `tags`, by default read from
    them.

    By default by what costs next to nothing and decides: conventions, units, intrinsics, coverage, what
    photos say of themselves (rotation, focal length), backgrounds of other views or places, photos in which
    nothing is to be seen, light that changed much, and whether the photos agree about the table. The last is
    known before where cameras and backgrounds stay: `table`.
    """
    reading = Reading(Capture.of(views), tuple(tags_of(views) if tags is None else tags))
    return _examine(reading, _look if thoroughly else partial(_glance, given=reading.capture, table=table))


@dataclass(frozen=True)
class KnownTable:
    """The table of a cell whose cameras and backgrounds stay."""

    finding: Finding
    """What the quick look says of it."""
    pictures: tuple[TablePicture, ...]
    """The backgrounds, as a quick look takes them."""

    @classmethod
    def of(cls, empty: Views) -> KnownTable | None:
        """By the backgrounds and cameras of a scene; None where a look would mend the cameras."""
        capture = Capture.of(empty)
        if check_convention(capture)[0] is not capture or not is_examinable(empty):
            return None
        pictures = coarse_pictures(empty)
        mended, findings = check_table_quickly(capture, pictures)
        return cls(findings[0], tuple(pictures)) if mended is capture and len(findings) == 1 else None


def _examine(reading: Reading, look: Look | None = None) -> Diagnosis:
    findings = list(reading.findings)
    if reading.capture is None:
        return Diagnosis(tuple(findings), None, reading.data, False)
    capture, found = check_convention(reading.capture)
    findings += found
    if is_examinable(capture.views):
        capture, found = (look or _look)(capture)
        findings += found
    numbered = tuple(_numbered(finding, capture) for finding in findings)
    return Diagnosis(numbered, capture, reading.data, reading.mended or capture is not reading.capture)


def _look(capture: Capture) -> tuple[Capture, list[Finding]]:
    """All checks that need cameras which look at the cube."""
    findings: list[Finding] = []
    for check in (check_intrinsics, check_pairs):
        capture, found = check(capture)
        findings += found
    wrong = {i for f in findings if f.problem in MISPLACED and f.level == Level.RED for i in f.views}
    mended, found = check_table(capture, without=wrong)
    findings += [*found, check_scale()]
    if worst(found) == Level.GREEN or mended is not capture:
        findings.append(check_empty_table(mended.views, without=wrong))
    capture = mended
    crops = table_crops(capture.views)
    findings += check_coverage(capture.views)
    unpaired = {i for finding in findings if finding.problem in UNPAIRED for i in finding.views}
    paired = [crop for crop in crops if crop.index not in unpaired]
    if paired:
        found = [*check_light(paired), *check_sharpness(paired)]
        findings += [_renumbered(finding, [crop.index for crop in paired]) for finding in found]
        is_alike = worst(found) == Level.GREEN
        findings.append(check_silhouettes(paired, capture.views.workspace, is_alike))
    return capture, [*findings, *check_brightness(crops)]


def _glance_at_table(capture: Capture, known: KnownTable | None) -> tuple[Capture, list[Finding]]:
    """Whether the backgrounds agree about the table, and whether some of them are images."""
    pictures = known.pictures if known else coarse_pictures(capture.views)
    of_table = (capture, [known.finding]) if known else check_table_quickly(capture, pictures)
    if any(finding.problem is TABLE_HEIGHT for finding in of_table[1]):
        return of_table
    mended, findings = check_exchanged_quickly(capture, pictures)
    if mended is not capture:
        of_table = check_table_quickly(mended, coarse_pictures(mended.views))
    capture, found = of_table
    return capture, [*findings, *found]


def _glance(
    capture: Capture, given: Capture | None = None, table: KnownTable | None = None
) -> tuple[Capture, list[Finding]]:
    """The checks that are quick and decide; of the light, what makes grasps fail. What is known of the
    `table` holds while nothing of the capture that was `given` was mended."""
    capture, findings = check_intrinsics(capture)
    crops = table_crops(capture.views, GLANCE_SIZE)
    mended, pairs = check_pairs_quickly(capture, crops)
    if mended is not capture:
        capture, crops = mended, table_crops(mended.views, GLANCE_SIZE)
    findings += pairs
    if any(finding.problem is SAME_PHOTO for finding in pairs):
        return capture, findings
    if not (wrong := {i for finding in pairs if finding.level == Level.RED for i in finding.views}):
        capture, found = _glance_at_table(capture, table if capture is given else None)
        findings += found
    light = [*check_brightness(crops), *check_light([s for s in crops if s.index not in wrong] or crops)]
    red = [finding for finding in light if finding.level == Level.RED]
    return capture, [*findings, *check_coverage(capture.views), *red]


def _numbered(finding: Finding, capture: Capture) -> Finding:
    """The finding with the views as scene.json numbers them, where some could not be read."""
    return finding if finding.item in ("files", "poses") else _renumbered(finding, capture.numbers)


def _renumbered(finding: Finding, numbers: Sequence[int]) -> Finding:
    return replace(finding, views=tuple(numbers[i] for i in finding.views))
