"""Camera models of COLMAP, and models that are damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from foreign_formats import Similarity, write_colmap
from neugrasp.errors import InputError
from neugrasp.importers.colmap import read_model
from neugrasp.views import Views

IMAGES = "# Image list\n1 1 0 0 0 0.1 0.2 0.3 7 a folder/first photo.png\n\n"


def model(folder: Path, camera: str) -> Path:
    (folder / "cameras.txt").write_text(f"# Camera list\n7 {camera}\n")
    (folder / "images.txt").write_text(IMAGES)
    return folder


@pytest.mark.parametrize(
    ("camera", "focal", "coefficients"),
    [
        ("SIMPLE_PINHOLE 640 480 500 320 240", (500, 500), (0, 0, 0, 0, 0)),
        ("PINHOLE 640 480 500 510 320 240", (500, 510), (0, 0, 0, 0, 0)),
        ("SIMPLE_RADIAL 640 480 500 320 240 0.1", (500, 500), (0.1, 0, 0, 0, 0)),
        ("RADIAL 640 480 500 320 240 0.1 0.2", (500, 500), (0.1, 0.2, 0, 0, 0)),
        ("OPENCV 640 480 500 510 320 240 0.1 0.2 0.01 0.02", (500, 510), (0.1, 0.2, 0.01, 0.02, 0)),
        (
            "FULL_OPENCV 640 480 500 510 320 240 0.1 0.2 0.01 0.02 0.3 0 0 0",
            (500, 510),
            (0.1, 0.2, 0.01, 0.02, 0.3),
        ),
    ],
)
def test_every_pinhole_is_known(tmp_path: Path, camera: str, focal: tuple, coefficients: tuple):
    (listed,) = read_model(model(tmp_path, camera))
    shot = listed.read()
    assert shot.name == "a folder/first photo.png"
    assert (shot.lens.width, shot.lens.height) == (640, 480)
    np.testing.assert_array_equal(
        shot.lens.intrinsics, [[focal[0], 0, 319.5], [0, focal[1], 239.5], [0, 0, 1]]
    )
    np.testing.assert_array_equal(shot.lens.coefficients, coefficients)
    np.testing.assert_allclose(shot.world_from_camera[:3, 3], (-0.1, -0.2, -0.3))


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ("OPENCV_FISHEYE 640 480 500 510 320 240 0 0 0 0", "OPENCV_FISHEYE cannot be undistorted here"),
        ("FULL_OPENCV 640 480 500 510 320 240 0 0 0 0 0 0.1 0 0", "FULL_OPENCV cannot be undistorted here"),
        ("SOMETHING 640 480 500", "SOMETHING cannot be undistorted here"),
        ("PINHOLE 640 480 500 320 240", "PINHOLE has 4 parameters, not 3"),
        ("PINHOLE 640 480 -5 500 320 240", "must be positive"),
        ("PINHOLE 640", "damaged COLMAP model"),
    ],
)
def test_other_cameras_are_refused(tmp_path: Path, camera: str, message: str):
    with pytest.raises(InputError, match=message):
        [listed.read() for listed in read_model(model(tmp_path, camera))]


@pytest.mark.parametrize("is_binary", [False, True])
@pytest.mark.parametrize("file", ["cameras", "images"])
def test_a_model_cut_short_is_damaged(tmp_path: Path, small_views: Views, is_binary: bool, file: str):
    folder = write_colmap(tmp_path, small_views, Similarity(), is_binary)
    path = folder / f"{file}.{'bin' if is_binary else 'txt'}"
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    with pytest.raises(InputError, match=r"damaged|parameters, not|which is not in the cameras' file"):
        [listed.read() for listed in read_model(folder)]


def test_a_folder_above_the_model_is_told_the_way(tmp_path: Path, small_views: Views):
    write_colmap(tmp_path, small_views, Similarity(), is_binary=True)
    with pytest.raises(InputError, match=r"no COLMAP model; .* did you mean .*sparse/0\?"):
        read_model(tmp_path)
    (tmp_path / "sparse/0/images.bin").write_bytes(bytes(8))
    with pytest.raises(InputError, match="no image is registered"):
        read_model(tmp_path / "sparse/0")
