"""The cell file: what is refused, and what `neugrasp cell check` says of a file that can be read."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from neugrasp.errors import InputError
from neugrasp.operation.check import findings_of, run
from neugrasp.operation.command import Cell
from neugrasp.robot.cell_file import read_cell, text_hash
from robot_cells import TWIN

needs_planner = pytest.mark.skipif(find_spec("ompl") is None, reason="needs neugrasp[robot]")


def changed(folder: Path, *changes: tuple[str, str]) -> Path:
    """The example with words replaced."""
    text = TWIN.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "cell.toml"
    path.write_text(text)
    return path


def test_the_example_is_read_as_it_stands():
    cell = read_cell(TWIN)
    assert cell.is_twin
    assert cell.arm.model.name == "ur5e"
    assert cell.gripper.gripper.max_opening == 0.085
    np.testing.assert_allclose(np.rad2deg(cell.drop), [110, -80, 110, -120, -90, 0])
    np.testing.assert_allclose(cell.workspace.world_from_workspace[:3, 3], [0.35, -0.15, -0.05])
    tcp = cell.gripper.flange_from_tcp
    np.testing.assert_allclose(tcp[:3, 3], [0, 0, 0.1443])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("version = 1", "version = 2", "version is 2; this program reads version 1; update"),
        ('model = "ur5e"', 'model = "ur6"', "arm.model is 'ur6'; it must be one of 'ur5e', 'ur5'"),
        ('driver = "twin"\nmodel = "ur5e"', 'driver = "ur"\nmodel = "ur5e"', "arm.address is missing"),
        (
            'driver = "twin"\nmodel = "ur5e"',
            'driver = "ur"\naddress = "192.0.2.1"\nmodel = "ur5e"',
            "either all three drivers are 'twin' or none",
        ),
        ("joint_speed = 1.5", "joint_speed = 9", "limits.joint_speed is 9; it must be a number from 0.05 to"),
        ("tcp_speed = 0.5", "tcp_speed = nan", "limits.tcp_speed is nan"),
        ("lowest_tcp = 0.012", "lowest_tcp = -0.05", "limits.lowest_tcp is -0.05"),
        ("keep_out = []", "keep_out = [{ low = [1, 0, 0], high = [0, 1, 1] }]", r"keep_out\[0\].low"),
        ("keep_out = []", "keep_outs = []", "limits.keep_out"),
        ("out_of_sight = [130.0,", "out_of_sight = [1300.0,", "places.out_of_sight is not six angles"),
        ("110.0, -120.0, -90.0", "190.0, -120.0, -90.0", "places.drop is .* beyond the range of a ur5e"),
        ("0.7071068, 0.7071068", "0.7071068, 0.1", "flange_from_camera.quaternion_xyzw has length"),
        ('set = "released"', 'set = "everywhere"', "views.set is 'everywhere'"),
        ("[459.14, 0.0, 319.75]", "[459.14, 0.0, 3197.5]", "principal point .* is far outside the photo"),
        ("width = 640", "width = 640\ndistortion = [0.1, 0, 0, 0, 0]", "camera.distortion is for hardware"),
        ("[twin]", "[twins]", "twins is unknown"),
        ("force = 20.0", 'force = 20.0\naddress = "x"', "gripper.address is for hardware"),
        ("format =", "format", "not valid TOML"),
        ("keep_out = []", f"keep_out = {5000 * '['}{5000 * ']'}", "not valid TOML .lists lie too deep"),
        ("seed = 0", f"seed = {5000 * '9'}", "not valid TOML"),
        ("seed = 0", "seed = 1979-05-27", "twin.seed is"),
        ("seed = 0", "seed = true", "twin.seed is True"),
        ("objects = 5", "objects = 5.0", "twin.objects is 5.0"),
        (
            "[130.0, -110.0, 110.0, -90.0, -90.0, 0.0]",
            "[2.269, -1.92, 1.92, -1.571, -1.571, 0.0]",
            "places.out_of_sight is .* which looks like radians",
        ),
        (
            "position = [-0.07, 0.0, 0.045]",
            "position = [-7.0, 0.0, 4.5]",
            "flange_from_camera.position is not",
        ),
        ("[459.14, 0.0, 319.75], [0.0, 459.14,", "[0.717, 0.0, 319.75], [0.0, 0.717,", "normalised"),
        ("[459.14, 0.0, 319.75]", "[459.14, 40.0, 319.75]", "camera.intrinsics: skew 40 is not 0"),
        ("[0.0, 459.14,", "[0.0, 45.914,", "camera.intrinsics: focal lengths .* differ too much"),
    ],
)
def test_a_mistake_is_named_with_its_file_and_field(tmp_path: Path, old: str, new: str, words: str):
    path = changed(tmp_path, (old, new))
    with pytest.raises(InputError, match=words) as told:
        read_cell(path)
    assert str(told.value).startswith(str(path))


def test_a_file_that_is_not_there_is_missing(tmp_path: Path):
    with pytest.raises(InputError, match="missing; a cell file is needed"):
        read_cell(tmp_path / "cell.toml")


def test_comments_do_not_change_what_a_cell_is(tmp_path: Path):
    assert text_hash(changed(tmp_path, ("[views]", "# Four of them.\n[views]"))) == text_hash(TWIN)
    assert text_hash(changed(tmp_path, ("seed = 0", "seed = 1"))) != text_hash(TWIN)


@pytest.mark.slow
@needs_planner
def test_nothing_is_wrong_with_the_example():
    said = run(Cell("check", TWIN))
    assert said.exit_code == 0
    assert "nothing is wrong" in said.text
    assert "wrong  " not in said.text


@pytest.mark.slow
@needs_planner
@pytest.mark.parametrize(
    ("old", "new", "what", "words"),
    [
        ("position = [0.35, -0.15, -0.05]", "position = [0.95, -0.15, -0.05]", "way through", "view 0"),
        ("drop = [110.0,", "drop = [178.0,", "drop place beside", "over the workspace"),
        ("-80.0, 110.0, -120.0", "-50.0, 110.0, -150.0", "place 'drop'", "above the table"),
        (
            "intrinsics = [[459.14, 0.0, 319.75], [0.0, 459.14,",
            "intrinsics = [[2000.0, 0.0, 319.75], [0.0, 2000.0,",
            "view 0 shows",
            "of 8 corners",
        ),
        ("zone = { low = [-0.1,", "zone = { low = [0.31,", "place 'drop'", "outside its zone"),
    ],
)
def test_what_is_wrong_is_said_before_anything_moves(
    tmp_path: Path, old: str, new: str, what: str, words: str
):
    path = changed(tmp_path, (old, new))
    problems = {finding.what: finding.problem for finding in findings_of(read_cell(path)) if finding.problem}
    found = [problem for name, problem in problems.items() if name.startswith(what)]
    assert found, problems
    assert words in found[0]
    assert run(Cell("check", path)).exit_code == 1


def test_distortion_is_read_and_what_the_straightened_photo_lacks_is_known(tmp_path: Path):
    text = TWIN.read_text().split("# What lies on")[0]
    for part, driver in (("arm", "ur"), ("gripper", "robotiq"), ("camera", "opencv")):
        text = text.replace(f'[{part}]\ndriver = "twin"', f'[{part}]\ndriver = "{driver}"\naddress = "1"')
    path = tmp_path / "cell.toml"
    path.write_text(text.replace("width = 640", "width = 640\ndistortion = [0.1, -0.2, 0.001, 0.002, 0.03]"))
    camera = read_cell(path).camera
    np.testing.assert_allclose(camera.lens.coefficients, [0.1, -0.2, 0.001, 0.002, 0.03])
    left, top, right, bottom = camera.camera.bounds
    assert (left, top, right, bottom) != (0, 0, 639, 359)
    assert (right - left) * (bottom - top) > 0.9 * 640 * 360
