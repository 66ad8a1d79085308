"""transforms.json: what else it says of its poses is heeded, or refused."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foreign_formats import OPENGL, Similarity, write_nerfstudio
from neugrasp.errors import InputError
from neugrasp.importers.nerfstudio import check_motion, read_transforms
from neugrasp.observation import Views


@pytest.fixture
def file(tmp_path: Path, small_views: Views) -> Path:
    return write_nerfstudio(tmp_path, small_views, Similarity())


def changed(file: Path, *frame: int, **more: Any) -> Path:
    """The file with more in it, or in some of its frames."""
    data = json.loads(file.read_text())
    for owner in [data["frames"][i] for i in frame] or [data]:
        owner.update(more)
    file.write_text(json.dumps(data))
    return file


def read(file: Path) -> list[Any]:
    return [entry.read() for entry in read_transforms(file, lambda _: (64, 36))]


@pytest.mark.parametrize("scale", [0.8, 2, 1e-3])
def test_a_scale_that_was_applied_must_be_undone(file: Path, scale: float):
    changed(file, applied_scale=scale)
    check_motion(file, has_scale=True, has_place=False)
    with pytest.raises(
        InputError, match=rf"applied_scale {scale:g}: .* metres_per_unit .*\({1 / scale:.6g} if"
    ):
        check_motion(file, has_scale=False, has_place=True)


def test_a_motion_that_was_applied_must_be_placed(file: Path):
    moved = [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]]
    for rows in (moved, [*moved, [0, 0, 0, 1]]):
        changed(file, applied_transform=rows)
        check_motion(file, has_scale=False, has_place=True)
        with pytest.raises(InputError, match=r"applied_transform: .* world_from_reconstruction"):
            check_motion(file, has_scale=True, has_place=False)


@pytest.mark.parametrize(
    "more",
    [
        {"applied_scale": 1.0},
        {"applied_transform": np.eye(4)[:3].tolist(), "orientation_override": "up"},
        {"aabb_scale": 16, "scale": 0.33, "offset": [0.5, 0.5, 0.5]},
    ],
)
def test_what_leaves_the_poses_alone_passes(
    file: Path, small_views: Views, caplog: pytest.LogCaptureFixture, more: dict
):
    with caplog.at_level(logging.WARNING):
        changed(file, **more)
        check_motion(file, has_scale=False, has_place=False)
        for posed, view in zip(read(file), small_views.frames, strict=True):
            np.testing.assert_allclose(posed.world_from_camera, view.camera.world_from_camera, atol=1e-12)
    assert not caplog.text


@pytest.mark.parametrize(
    "more",
    [
        {"from_na": True},
        {"camera_convention": "opencv"},
        {"rolling_shutter": [0, 0, 0.02, 0]},
        {"ftheta_p1": 0.3, "ftheta_p0": 0.1},
        {"latlong": True},
        {"camera_model": "EQUIRECTANGULAR"},
        {"is_fisheye": True},
    ],
)
@pytest.mark.parametrize("frame", [(), (2,)], ids=["file", "frame"])
def test_what_bends_is_refused_where_it_counts(file: Path, more: dict, frame: tuple[int, ...]):
    changed(file, *frame, **more)
    if "camera_convention" in more and not frame:
        more = {"camera_convention": "y_up"}
        changed(file, **more)
    with pytest.raises(InputError, match=next(iter(more))):
        read(file)
    if frame:
        listed = read_transforms(file, lambda _: (64, 36))
        for i in (0, 1, 3):
            listed[i].read()


def test_a_file_may_say_that_its_cameras_are_opengls(file: Path, caplog: pytest.LogCaptureFixture):
    with caplog.at_level(logging.WARNING):
        read(changed(file, camera_convention="OpenGL"))
    assert not caplog.text


def test_a_key_of_another_name_is_told(file: Path, caplog: pytest.LogCaptureFixture):
    with caplog.at_level(logging.WARNING):
        read(changed(file, 0, sharpnes=3.0))
    assert "the key 'sharpnes' is not known and ignored; did you mean 'sharpness'?" in caplog.text
    with pytest.raises(
        InputError, match=r"'transform_matrx' is a pose, .*; did you mean 'transform_matrix'\?"
    ):
        read(changed(file, 0, transform_matrx=OPENGL.tolist()))


def test_the_mark_of_byte_order_and_windows_lines_are_read(file: Path):
    text = json.dumps(json.loads(file.read_text()), indent=1).replace("\n", "\r\n")
    file.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert len(read(file)) == 4
