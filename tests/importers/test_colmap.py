"""Camera models of COLMAP, and models that are damaged."""

from __future__ import annotations

import logging
import struct
from pathlib import Path

import numpy as np
import pytest

from foreign_formats import Similarity, write_colmap
from neugrasp.errors import InputError
from neugrasp.importers.colmap import read_model
from neugrasp.observation import Views

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
    posed = listed.read()
    assert posed.name == "a folder/first photo.png"
    assert (posed.lens.width, posed.lens.height) == (640, 480)
    np.testing.assert_array_equal(
        posed.lens.intrinsics, [[focal[0], 0, 319.5], [0, focal[1], 239.5], [0, 0, 1]]
    )
    np.testing.assert_array_equal(posed.lens.coefficients, coefficients)
    np.testing.assert_allclose(posed.world_from_camera[:3, 3], (-0.1, -0.2, -0.3))


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


POSE = "0.5 0.5 0.5 0.5 0.1 0.2 0.3 7"
POINTS = "3.5 4.5 -1 7.0 8.0 12"


@pytest.mark.parametrize(
    ("lines", "is_told"),
    [
        ([f"1 {POSE} a.png", "", f"2 {POSE} b c.png", "", f"3 {POSE} 3.jpg", ""], False),
        ([f"1 {POSE} a.png", POINTS, f"2 {POSE} b c.png", POINTS, f"3 {POSE} 3.jpg", POINTS], False),
        ([f"1 {POSE} a.png", f"2 {POSE} b c.png", f"3 {POSE} 3.jpg"], True),
        ([f"1 {POSE} a.png", POINTS, f"2 {POSE} b c.png", f"3 {POSE} 3.jpg", ""], True),
        (["", f"1 {POSE} a.png", "", "", f"2 {POSE} b c.png", POINTS, "", f"3 {POSE} 3.jpg"], False),
    ],
    ids=["empty lines", "points", "no lines between", "one line missing", "more lines than needed"],
)
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"], ids=["", "byte order mark"])
def test_images_are_told_from_points(
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    lines: list[str],
    is_told: bool,
    ending: str,
    mark: bytes,
):
    folder = model(tmp_path, "PINHOLE 640 480 500 510 320 240")
    text = ending.join(["# Image list", "#", *lines, ""])
    (folder / "images.txt").write_bytes(mark + text.encode())
    cameras = (folder / "cameras.txt").read_text()
    (folder / "cameras.txt").write_bytes(mark + cameras.replace("\n", ending).encode())
    with caplog.at_level(logging.WARNING):
        posed_images = [listed.read() for listed in read_model(folder)]
    assert [posed.name for posed in posed_images] == ["a.png", "b c.png", "3.jpg"]
    assert all(np.allclose(posed.world_from_camera[:3, 3], (-0.2, -0.3, -0.1)) for posed in posed_images)
    assert ("the line of the points is missing" in caplog.text) == is_told


@pytest.mark.parametrize(
    "lines",
    [
        [f"1 {POSE} a.png", "3.5 4.5"],
        [f"1 {POSE} a.png", "", "2 0.5 0.5"],
        [POINTS, f"1 {POSE} a.png"],
        [f"1 {POSE} a.png", "3.5 4.5 word"],
        [f"1 {POSE} a.png", "3.5 4.5 0.5"],
    ],
)
def test_a_line_that_is_neither_is_damaged(tmp_path: Path, lines: list[str]):
    folder = model(tmp_path, "PINHOLE 640 480 500 510 320 240")
    (folder / "images.txt").write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"images\.txt: .* is neither the pose of an image .* damaged\?"):
        read_model(folder)


def binary(folder: Path, kinds: list[int], counts: list[int]) -> Path:
    """A model with a camera of each kind, numbered from 1, and an image a for each."""
    cameras = struct.pack("<Q", len(kinds))
    images = struct.pack("<Q", len(kinds))
    for i, (kind, count) in enumerate(zip(kinds, counts, strict=True), start=1):
        values = (500.0, 500.0, 320.0, 240.0, *[0.01] * 12)[:count]
        cameras += struct.pack(f"<iiQQ{count}d", i, kind, 640, 480, *values)
        images += (
            struct.pack("<i7di", i, 1, 0, 0, 0, 0, 0, 1, i) + f"{i}.png".encode() + struct.pack("<bQ", 0, 0)
        )
    (folder / "cameras.bin").write_bytes(cameras)
    (folder / "images.bin").write_bytes(images)
    return folder


@pytest.mark.parametrize(
    ("number", "count", "name"),
    [
        (5, 8, "OPENCV_FISHEYE"),
        (10, 12, "THIN_PRISM_FISHEYE"),
        (11, 16, "RAD_TAN_THIN_PRISM_FISHEYE"),
        (12, 4, "SIMPLE_DIVISION"),
        (13, 5, "DIVISION"),
        (14, 3, "SIMPLE_FISHEYE"),
        (15, 4, "FISHEYE"),
        (16, 6, "EUCM"),
    ],
)
def test_other_models_are_named_and_judged_only_where_they_are_wanted(
    tmp_path: Path, number: int, count: int, name: str
):
    listed = read_model(binary(tmp_path, [number, 1], [count, 4]))
    assert listed[1].read().lens.intrinsics[0, 0] == 500
    with pytest.raises(InputError, match=rf"{name} cannot be undistorted here.*model OPENCV.*backgrounds"):
        listed[0].read()


@pytest.mark.parametrize(("number", "words"), [(17, "EQUIRECTANGULAR"), (99, "number 99"), (-1, "number -1")])
def test_a_model_of_unknown_length_is_named_with_a_way_out(tmp_path: Path, number: int, words: str):
    with pytest.raises(InputError, match=rf"{words}.* model_converter --output_type TXT"):
        read_model(binary(tmp_path, [1, number], [4, 4]))


def test_only_chosen_images_are_judged(tmp_path: Path):
    folder = model(tmp_path, "PINHOLE 640 480 500 510 320 240")
    (folder / "cameras.txt").write_text(
        "7 PINHOLE 640 480 500 510 320 240\n8 OPENCV_FISHEYE 640 480 500 500 320 240 0 0 0 0\n9 NEW 1 1\n"
    )
    lines = [
        f"1 {POSE} a.png",
        "",
        f"2 {POSE[:-1]}8 b.png",
        "",
        f"3 {POSE[:-1]}9 c.png",
        "",
        f"4 0 {POSE[4:]} d.png",
    ]
    (folder / "images.txt").write_text("\n".join(lines))
    good, *others = read_model(folder)
    assert good.read().lens.width == 640
    for listed, words in zip(others, ("OPENCV_FISHEYE", "NEW", "quaternion of length"), strict=True):
        with pytest.raises(InputError, match=words):
            listed.read()


def test_a_number_of_two_cameras_is_damage(tmp_path: Path):
    folder = model(tmp_path, "PINHOLE 640 480 500 510 320 240\n7 PINHOLE 640 480 600 610 320 240")
    with pytest.raises(InputError, match=r"cameras\.txt: two cameras have the number 7"):
        read_model(folder)
