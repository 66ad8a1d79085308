"""Gripper files: the bundled ones are sound, and a bad one is refused by file and field."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from neugrasp.errors import InputError
from neugrasp.gripper import Gripper, bundled

DATA = json.loads((Path(__file__).parents[1] / "src/neugrasp/grippers/robotiq_2f85.json").read_text())


def test_the_panda_is_franka_s_hand() -> None:
    panda = Gripper.load("panda")
    assert (panda.max_opening, panda.finger_depth, panda.tcp_height) == (0.08, 0.05, 0.1034)
    assert panda.tip_height == pytest.approx(0.1124, abs=3e-4)
    grasp_point = panda.tcp_height - panda.tcp_depth
    assert grasp_point == pytest.approx(0.062)
    assert panda.tip_height - grasp_point == pytest.approx(panda.finger_depth, abs=1e-3)


@pytest.mark.parametrize("name", bundled())
def test_the_wireframe_reaches_from_the_tips_to_the_arm(name: str) -> None:
    gripper = Gripper.load(name)
    for opening in (0.0, 0.03, gripper.max_opening):
        segments = gripper.wireframe(opening)
        assert segments.shape == (4, 2, 3)
        points = segments.reshape(-1, 3)
        assert np.all(points[:, 0] == 0)
        assert np.ptp(points[:, 1]) == pytest.approx(opening)
        assert points[:, 2].max() == pytest.approx(gripper.tip_height - gripper.tcp_height)
        assert points[:, 2].min() < gripper.palm_height - gripper.tcp_height


@pytest.mark.parametrize("name", bundled())
def test_the_pads_meet_at_the_tcp_when_closed(name: str) -> None:
    """At the height of the TCP the finger's inner face is the plane y = 0, and the TCP is on the pad."""
    gripper = Gripper.load(name)
    corners = np.concatenate(gripper.finger.hulls) + np.array([0, 0, gripper.finger_mount])
    pad = corners[np.abs(corners[:, 1]) < 1e-3]
    assert pad[:, 2].min() < gripper.tcp_height < pad[:, 2].max()
    assert np.abs(pad[:, 0]).max() > 0.005


def test_a_box_is_the_hull_of_its_corners(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(DATA))
    boxed = Gripper.load(path)
    data = json.loads(path.read_text())
    data["palm"]["parts"] = [{"hull": hull.tolist()} for hull in boxed.palm.hulls]
    path.write_text(json.dumps(data))
    hulled = Gripper.load(path)
    for a, b in zip(boxed.palm.hulls, hulled.palm.hulls, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_allclose(np.ptp(boxed.palm.hulls[0], axis=0), DATA["palm"]["parts"][0]["size"])


def change(*path: str | int, value: Any) -> Callable[[dict[str, Any]], None]:
    def apply(data: dict[str, Any]) -> None:
        inner: Any = data
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = value

    return apply


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (change("format", value="urdf"), r"format is 'urdf'.*neugrasp-gripper"),
        (change("version", value=2), r"version is 2.*version 1"),
        (change("name", value=""), "name must be"),
        (lambda data: data.pop("max_opening"), r"max_opening is missing; present: format"),
        (change("max_opening", value=85), r"max_opening is 85; .* from 0.005 to 0.5 m"),
        (change("max_opening", value="wide"), r"max_opening is 'wide'"),
        (change("max_opening", value=float("nan")), r"NaN is not a finite number"),
        (change("max_opening", value=True), r"max_opening is True"),
        (change("tcp_height", value=0.3), r"tcp_height .* between the palm's front \(0.094 m\)"),
        (change("tcp_depth", value=0.2), r"tcp_depth"),
        (change("palm", value=[]), r"palm is not a JSON object"),
        (change("palm", "parts", value=[]), r"palm\.parts must be"),
        (change("palm", "parts", 0, "size", value=[0.1, 0.1]), r"palm\.parts\[0\]\.size is not \[x, y, z\]"),
        (change("palm", "parts", 0, "size", value=[0.1, 0, 0.1]), r"size .* longer than 0 m"),
        (change("palm", "parts", 0, value={"centre": [0, 0, 0]}), r"parts\[0\]\.hull is missing"),
        (change("unit", value="mm"), "unit is unknown"),
        (change("max_openning", value=0.1), "max_openning is unknown; did you mean 'max_opening'"),
        (change("palm", "offset", value=[0, 0, 0.1]), r"palm\.offset is unknown"),
        (change("finger", "pads", "friction", value=1), r"finger\.pads\.friction is unknown"),
        (change("finger", "parts", 0, "rpy", value=[0, 0, 1]), r"parts\[0\]\.rpy is unknown"),
        (change("palm", "parts", 0, value={"hull": [[0, 0, 0], [0, 0, 1]]}), r"hull is flat"),
        (change("palm", "parts", 0, value={"hull": [[0, 0, 0], [75, 0, 1]]}), r"hull is not .* within 1 m"),
        (change("finger", "mass", value=-1), r"finger\.mass is -1"),
        (change("finger", "pads", "stiffness", value=0), r"finger\.pads\.stiffness"),
        (change("finger", "parts", 0, "centre", value=[0, 0.05, 0.14425]), r"finger\.parts .* y = 0"),
    ],
)
def test_a_bad_file_is_refused_by_file_and_field(
    tmp_path: Path, edit: Callable[[dict[str, Any]], None], message: str
) -> None:
    data = json.loads(json.dumps(DATA))
    edit(data)
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=message) as caught:
        Gripper.load(path)
    assert str(path) in str(caught.value)


def test_files_that_are_no_gripper_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "gripper.json"
    with pytest.raises(InputError, match="missing; a gripper is needed"):
        Gripper.load(path)
    path.write_text("{")
    with pytest.raises(InputError, match="not valid JSON"):
        Gripper.load(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="no text in UTF-8"):
        Gripper.load(path)
    path.write_text("[]")
    with pytest.raises(InputError, match="not a JSON object"):
        Gripper.load(path)


def test_an_unknown_name_lists_the_choices() -> None:
    with pytest.raises(InputError, match=r"'pandaa'.*panda, robotiq_2f85"):
        Gripper.load("pandaa")
