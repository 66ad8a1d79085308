"""Captures broken on purpose, each in one way: it is found, the view is named, what is certain is mended."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from broken import CASES, Case
from broken_folders import FOLDER_CASES, FolderCase
from troubleshooting import COMMAND, FILE, page, without_numbers

from neugrasp import cli
from neugrasp.data.scene_folder import read_json, read_scene, write_scene
from neugrasp.doctor.capture import Capture
from neugrasp.doctor.examination import Diagnosis, examine, examine_folder, examine_read
from neugrasp.doctor.findings import Finding, Level
from neugrasp.doctor.fix import write_fixed
from neugrasp.doctor.messages import INVERTED_WORKSPACE
from neugrasp.errors import InputError
from neugrasp.geometry.pose import from_quaternion, inverse
from neugrasp.observation import Views

QUICK = {
    "cameras of OpenGL or Blender",
    "poses inverted",
    "poses in millimetres",
    "the cube 3 m away",
    "the cube upside down",
    "intrinsics of twice the resolution",
    "two backgrounds swapped",
    "one background shifted by (2.4, -1.2) pixels",
    "the lamp moved to the other side",
    "one view only",
    *(case.what for case in FOLDER_CASES),
}
"""One of each kind, for a bare `pytest`; `make test` examines all."""


def marked(cases: Sequence[Case | FolderCase]) -> list[Any]:
    """The cases as parameters, those not among `QUICK` marked as slow."""
    return [case if case.what in QUICK else pytest.param(case, marks=pytest.mark.slow) for case in cases]


def test_the_quick_cases_are_cases():
    assert {case.what for case in [*CASES, *FOLDER_CASES]} > QUICK


@dataclass(repr=False)
class Clinic:
    """Examines every case once, however many tests ask."""

    good: Views
    folder: Path
    seen: dict[str, Diagnosis] = field(default_factory=dict)

    def diagnosis(self, case: Case | FolderCase) -> Diagnosis:
        if case.what not in self.seen:
            if isinstance(case, Case):
                self.seen[case.what] = examine(Capture.of(case.spoil(self.good)))
            else:
                self.seen[case.what] = examine_folder(self.spoilt(case))
        return self.seen[case.what]

    def spoilt(self, case: FolderCase) -> Path:
        target = self.folder / re.sub(r"\W+", "-", case.what)
        if not target.exists():
            shutil.copytree(self.folder / "good", target)
            case.spoil(target)
        return target

    def finding(self, case: Case | FolderCase) -> Finding:
        """Of the problem that the case must get."""
        diagnosis = self.diagnosis(case)
        found = [finding for finding in diagnosis.findings if finding.problem is case.problem]
        assert found, diagnosis.lines(Level.YELLOW)
        return found[0]


@pytest.fixture(scope="module")
def clinic(good: Views, tmp_path_factory: pytest.TempPathFactory) -> Clinic:
    folder = tmp_path_factory.mktemp("clinic")
    write_scene(folder / "good", good)
    return Clinic(good, folder)


@pytest.mark.slow
def test_the_good_capture_is_green(clinic: Clinic):
    for diagnosis in (examine(Capture.of(clinic.good)), examine_folder(clinic.folder / "good")):
        assert diagnosis.level == Level.GREEN, diagnosis.lines(Level.YELLOW)
        assert not diagnosis.is_mended


@pytest.mark.slow
@pytest.mark.parametrize("case", marked([*CASES, *FOLDER_CASES]), ids=lambda case: case.what)
def test_every_broken_capture_gets_its_diagnosis(clinic: Clinic, case: Case | FolderCase):
    finding = clinic.finding(case)
    assert (finding.level, finding.views) == (case.level, case.views), finding.line()
    assert clinic.diagnosis(case).level == case.level, clinic.diagnosis(case).lines(Level.YELLOW)


@pytest.mark.parametrize(
    "case", marked([case for case in CASES if case.is_mendable]), ids=lambda case: case.what
)
def test_what_is_certain_is_mended_exactly(clinic: Clinic, case: Case):
    diagnosis = clinic.diagnosis(case)
    assert diagnosis.is_mended
    assert diagnosis.capture is not None
    assert_same(diagnosis.capture.views, clinic.good, case.tolerance)


@pytest.mark.parametrize(
    "case", marked([case for case in CASES if not case.is_mendable]), ids=lambda case: case.what
)
def test_what_is_not_certain_is_left_as_it_is(clinic: Clinic, case: Case):
    assert not clinic.diagnosis(case).is_mended


AT_FIRST_SIGHT = (
    *("two backgrounds swapped", "two images swapped", "one image mirrored, its background not"),
    *("a lid on the camera for the empty table", "one stop more exposure", "a background from another place"),
    "all photos mirrored",
)


@pytest.mark.slow
@pytest.mark.parametrize("what", AT_FIRST_SIGHT)
def test_what_makes_grasps_fail_is_red_before_a_prediction_too(clinic: Clinic, tmp_path: Path, what: str):
    case = named(what)
    write_scene(tmp_path, case.spoil(clinic.good))
    found = examine_read(read_scene(tmp_path)).findings
    assert case.problem in [finding.problem for finding in found if finding.level == Level.RED]


def test_the_quick_look_at_the_good_capture_is_green(clinic: Clinic):
    assert examine_read(read_scene(clinic.folder / "good")).verdict == "green"


def assert_same(views: Views, other: Views, tolerance: float = 1e-9) -> None:
    """The same photos by the same cameras; principal points only to half a pixel."""
    mine, theirs = views.workspace.world_from_workspace, other.workspace.world_from_workspace
    np.testing.assert_allclose(mine, theirs, atol=tolerance)
    for one, two in zip(views.frames, other.frames, strict=True):
        np.testing.assert_array_equal(one.image, two.image)
        np.testing.assert_array_equal(one.background, two.background)
        np.testing.assert_allclose(one.camera.world_from_camera, two.camera.world_from_camera, atol=tolerance)
        np.testing.assert_allclose(one.camera.intrinsics, two.camera.intrinsics, atol=0.5)


def named(what: str) -> Case:
    (case,) = [case for case in CASES if case.what == what]
    return case


BY_COMMAND = [
    named("cameras of OpenGL or Blender"),
    *(pytest.param(named(f"poses {how}"), marks=pytest.mark.slow) for how in ("inverted", "in millimetres")),
]
BY_NAME = marked(
    [
        named(what)
        for what in (
            "OpenGL cameras in millimetres",
            "two backgrounds swapped",
            "two images swapped",
            "all images one view further",
            "images and backgrounds exchanged",
        )
    ]
)


@pytest.mark.slow
@pytest.mark.parametrize("case", BY_COMMAND, ids=lambda case: case.what)
def test_the_command_writes_a_corrected_copy_that_is_green(
    clinic: Clinic, tmp_path: Path, case: Case, capsys: pytest.CaptureFixture[str]
):
    bad, fixed = tmp_path / "bad", tmp_path / "fixed"
    write_scene(bad, case.spoil(clinic.good))
    written = (bad / "scene.json").read_text()
    assert cli.main(["doctor", str(bad), "--fix", str(fixed)]) == 1
    then = f"next: neugrasp predict {fixed} --out outputs/fixed\n"
    assert capsys.readouterr().out.endswith(f"{bad}: red\n{fixed}: green\n{then}")
    assert_same(read_scene(fixed), clinic.good)
    assert (bad / "scene.json").read_text() == written


@pytest.mark.slow
@pytest.mark.parametrize("case", BY_NAME, ids=lambda case: case.what)
def test_the_corrected_copy_of_a_capture_is_the_good_scene(clinic: Clinic, tmp_path: Path, case: Case):
    write_scene(tmp_path / "bad", case.spoil(clinic.good))
    on_disk = replace(clinic.diagnosis(case), data=read_json(tmp_path / "bad/scene.json"))
    write_fixed(on_disk, tmp_path / "bad", tmp_path / "fixed")
    assert_same(read_scene(tmp_path / "fixed"), clinic.good)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [case for case in FOLDER_CASES if case.is_mendable], ids=lambda case: case.what
)
def test_the_corrected_copy_of_a_folder_is_the_good_scene(clinic: Clinic, tmp_path: Path, case: FolderCase):
    folder = clinic.spoilt(case)
    write_fixed(clinic.diagnosis(case), folder / "scene.json", tmp_path / "fixed")
    assert_same(read_scene(tmp_path / "fixed"), clinic.good)


@pytest.mark.slow
def test_nothing_is_written_where_nothing_is_certain(clinic: Clinic, tmp_path: Path):
    good = clinic.folder / "good"
    with pytest.raises(InputError, match="nothing was found that can be corrected with certainty"):
        write_fixed(examine_folder(good), good, tmp_path / "fixed")
    (missing,) = [case for case in FOLDER_CASES if case.what == "a photo missing"]
    with pytest.raises(InputError, match=r"cannot be fixed: .*images/1\.png: missing"):
        write_fixed(clinic.diagnosis(missing), clinic.spoilt(missing), tmp_path / "fixed")
    assert not (tmp_path / "fixed").exists()


@pytest.mark.slow
def test_a_folder_in_use_is_not_written_into(clinic: Clinic, tmp_path: Path):
    (case,) = [case for case in FOLDER_CASES if case.what == "poses transposed"]
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="is not empty"):
        write_fixed(clinic.diagnosis(case), clinic.spoilt(case), tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.slow
def test_photos_named_as_windows_does_are_copied(clinic: Clinic, tmp_path: Path):
    """With backslashes, and with folders in folders."""
    (case,) = [case for case in FOLDER_CASES if case.what == "poses transposed"]
    shutil.copytree(clinic.spoilt(case), tmp_path / "bad")
    (tmp_path / "bad/images").rename(tmp_path / "bad/photos")
    (tmp_path / "bad/rig").mkdir()
    (tmp_path / "bad/photos").rename(tmp_path / "bad/rig/images")
    file = tmp_path / "bad/scene.json"
    data = json.loads(file.read_text())
    for view in data["views"]:
        view["image"] = "rig\\" + view["image"].replace("/", "\\")
        view["background"] = view["background"].replace("/", "\\")
    file.write_text(json.dumps(data))
    write_fixed(examine_folder(tmp_path / "bad"), file, tmp_path / "fixed")
    assert_same(read_scene(tmp_path / "fixed"), clinic.good)
    assert (tmp_path / "fixed/rig/images/0.png").is_file()
    assert not [path for path in (tmp_path / "fixed").iterdir() if "\\" in path.name]


@pytest.mark.slow
def test_an_inverted_workspace_is_found_and_mended(good: Views):
    """In a world of its own: `good` has the cube at the origin, where the inverse is the same."""
    new_from_old = from_quaternion((0.1, -0.2, 0.6, 0.7), (0.4, -0.3, 0.8))
    views = tuple(replace(view, camera=view.camera.moved(new_from_old)) for view in good.frames)
    moved = Views(views, replace(good.workspace, world_from_workspace=new_from_old))
    inverted = replace(good.workspace, world_from_workspace=inverse(new_from_old))
    diagnosis = examine(Capture.of(Views(views, inverted)))
    assert [finding.problem for finding in diagnosis.findings if finding.level >= Level.YELLOW] == [
        INVERTED_WORKSPACE
    ]
    assert diagnosis.capture is not None
    assert_same(diagnosis.capture.views, moved)


@pytest.mark.slow
def test_the_page_in_the_docs_is_what_the_doctor_says(clinic: Clinic):
    cases = [*CASES, *FOLDER_CASES]
    text = page([(case.what, clinic.finding(case), case.is_mendable) for case in cases])
    text = re.sub(rf"{re.escape(str(clinic.folder))}/[\w-]+", "SCENE", text)
    if os.environ.get("UPDATE_DOCS"):
        FILE.write_text(text)
    assert without_numbers(FILE.read_text()) == without_numbers(text), f"out of date; run: {COMMAND}"
    assert len(cases) >= 20
