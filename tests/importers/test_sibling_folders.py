"""Photos' names, COLMAP's texts, hand-eye calibrations, EXIF: other inputs of the kinds that once failed."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Picture
from scipy.spatial.transform import Rotation

from foreign_formats import (
    FLANGE_FROM_CAMERA,
    OPENGL,
    Similarity,
    write_colmap,
    write_nerfstudio,
    write_robot,
)
from neugrasp import cli
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, inverse, rigid
from neugrasp.importers.colmap import read_model
from neugrasp.importers.nerfstudio import read_transforms
from neugrasp.importers.photo_folder import PhotoFolder
from neugrasp.observation import Views
from patterned_table import edited, imported, patterned_views


@pytest.fixture(scope="module")
def views() -> Views:
    return patterned_views()


FILES = (
    *("left/Ä 1.png", "right/0.png", "Left2/0.JPG", "IMG.001.png", "a.png", "A.jpg", "b.png", "sub/b.png"),
    *("x.tar.png", "c%20d.png", "лево/0.jpeg"),
)


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("left/A\u0308 1.png", "left/Ä 1.png"),
        ("LEFT\\ä 1.PNG", "left/Ä 1.png"),
        ("right\\0.png", "right/0.png"),
        ("\\\\server\\share\\right\\0.png", "right/0.png"),
        ("file:///home/right/0.png", "right/0.png"),
        ("right/../right/./0.png", "right/0.png"),
        ("left2/0.heic", "Left2/0.JPG"),
        ("ЛЕВО/0.png", "лево/0.jpeg"),
        ("a.jpg", "A.jpg"),
        ("a.png", "a.png"),
        ("other/b.png", "b.png"),
        ("sub\\b", "sub/b.png"),
        ("x.tar", "x.tar.png"),
        ("IMG.001", "IMG.001.png"),
        ("0.png", None),
        ("IMG", None),
        ("c d.png", None),
        ("right/0.png?v=1", None),
    ],
)
def test_the_photo_of_a_name_or_none(tmp_path: Path, name: str, found: str | None):
    for file in FILES:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_bytes(b"x")
    assert PhotoFolder(tmp_path).find(name) == (None if found is None else tmp_path / found)


CAMERA, IMAGE = "1 PINHOLE 640 480 500 500 320 240\n", "1 1 0 0 0 .1 .2 .3 1 a.png\n\n"


def model(folder: Path, cameras: str, images: str) -> list[Any]:
    (folder / "cameras.txt").write_text(cameras, encoding="utf-8")
    (folder / "images.txt").write_text(images, encoding="utf-8")
    return read_model(folder)


@pytest.mark.parametrize(
    ("cameras", "images", "name"),
    [
        (CAMERA.replace(" ", "\t"), IMAGE.replace(" ", "\t"), "a.png"),
        (CAMERA, IMAGE.replace("1 1 0", "1 -1 0"), "a.png"),
        (CAMERA + "# end\n", IMAGE + "# end\n", "a.png"),
        (CAMERA, IMAGE.replace("a.png", "my photo 1.png"), "my photo 1.png"),
        (CAMERA, IMAGE.replace("a.png", "фото/#1.png"), "фото/#1.png"),
        (CAMERA, IMAGE.replace("a.png", "rig\\cam0\\1.png"), "rig\\cam0\\1.png"),
        (CAMERA, IMAGE.replace("a.png", "0001"), "0001"),
    ],
)
def test_texts_of_colmap_that_are_the_same(tmp_path: Path, cameras: str, images: str, name: str):
    (entry,) = model(tmp_path, cameras, images)
    assert entry.name == name
    np.testing.assert_allclose(entry.read().world_from_camera[:3, 3], [-0.1, -0.2, -0.3])


@pytest.mark.parametrize(
    ("cameras", "images", "message"),
    [
        (CAMERA.replace("320 240", ".5 .5"), IMAGE, "normalised"),
        (CAMERA.replace("500 500", "500,0 500,0"), IMAGE, "damaged COLMAP model"),
        (CAMERA.lower(), IMAGE, "pinhole cannot be undistorted"),
        (CAMERA.replace("PINHOLE", "FOV").strip() + " .9\n", IMAGE, "FOV cannot be undistorted"),
        (CAMERA.replace("PINHOLE", "OPENCV"), IMAGE, "OPENCV has 8 parameters, not 4"),
        (CAMERA, IMAGE.replace(" ", ","), "neither the pose of an image"),
        (CAMERA, IMAGE.replace("1 1 0", "1 2 0"), "quaternion of length 2"),
    ],
)
def test_texts_of_colmap_that_are_none(tmp_path: Path, cameras: str, images: str, message: str):
    with pytest.raises(InputError, match=message):
        [entry.read() for entry in model(tmp_path, cameras, images)]


def test_a_name_of_two_images_is_refused(views: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    source = write_colmap(tmp_path / "a", views, Similarity(), is_binary=True)
    data = (source / "images.bin").read_bytes().replace(b"view_2.png", b"view_0.png")
    (source / "images.bin").write_bytes(data)
    assert imported(tmp_path, ["colmap", str(source)], views) == 2
    assert "view_0.png is there twice; which of its poses is meant?" in capsys.readouterr().err


def turn(axes: str, degrees: float | list[float]) -> Array:
    return rigid(Rotation.from_euler(axes, degrees, degrees=True).as_matrix())


def stretched(factor: float) -> Callable[[Array], Array]:
    return lambda pose: rigid(pose[:3, :3], factor * pose[:3, 3])


Change = Callable[[Array], Array]
MIXED: dict[str, tuple[Change, Change]] = {
    "both inverse": (inverse, inverse),
    "OpenGL, flange inverse": (lambda pose: pose @ OPENGL, inverse),
    "OpenGL on both sides": (lambda pose: OPENGL @ pose @ OPENGL, np.array),
    "tool0 for flange": (np.array, lambda pose: pose @ turn("yz", [90, 90])),
    "link8 for hand": (np.array, lambda pose: pose @ turn("z", -45)),
    "flange half a turn": (np.array, lambda pose: pose @ turn("z", 180)),
    "camera half a turn": (lambda pose: pose @ turn("z", 180), np.array),
    "camera a quarter turn": (lambda pose: pose @ turn("z", 90), np.array),
    "base half a turn": (np.array, lambda pose: turn("z", 180) @ pose),
    "y up": (np.array, lambda pose: turn("x", -90) @ pose),
    "hand-eye in cm": (stretched(100), np.array),
    "hand-eye in inches": (stretched(39.37), np.array),
    "flange in cm": (np.array, stretched(100)),
    "hand-eye without its place": (stretched(0), np.array),
    "hand-eye negated": (stretched(-1), np.array),
    "hand-eye of rows": (lambda pose: rigid(pose[:3, :3].T, pose[:3, 3]), np.array),
    "flange of rows": (np.array, lambda pose: rigid(pose[:3, :3].T, pose[:3, 3])),
}


@pytest.mark.slow
@pytest.mark.parametrize("mistake", MIXED)
def test_mixed_up_frames_of_a_robot_never_pass_in_silence(
    views: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str], mistake: str
):
    """The import refuses them, or the doctor says red of how the photos have the table."""
    hand_eye, flange = MIXED[mistake]

    def edit(data: dict[str, Any]) -> None:
        data["flange_from_camera"] = hand_eye(FLANGE_FROM_CAMERA).tolist()
        for entry in data["views"]:
            entry["base_from_flange"] = flange(np.array(entry["base_from_flange"])).tolist()

    file = edited(write_robot(tmp_path / "a", views), edit)
    if imported(tmp_path, ["robot", str(file)], views) == 2:
        assert "neugrasp: error: " in capsys.readouterr().err
        return
    capsys.readouterr()
    assert cli.main(["doctor", str(tmp_path / "scene")]) == 1
    out = capsys.readouterr().out
    assert any(line.startswith(("red     table", "red     convention")) for line in out.splitlines()), out


@pytest.mark.parametrize("kind", ["MPO", "PNG"])
@pytest.mark.parametrize("folder", ["images", "backgrounds"])
def test_a_tag_of_one_of_the_two_photos_is_told(
    views: Views, tmp_path: Path, caplog: pytest.LogCaptureFixture, kind: str, folder: str
):
    """MPO is what phones and stereo cameras write as .jpg."""
    file = write_nerfstudio(tmp_path / "a", views, Similarity())
    tags = Picture.Exif()
    tags[274] = 8
    old = tmp_path / "a" / folder / "view_1.png"
    with Picture.open(old) as picture:
        pixels = picture.copy()
    old.unlink()
    new = old.with_suffix(".jpg" if kind == "MPO" else ".png")
    pixels.save(new, format=kind, exif=tags)
    assert imported(tmp_path, ["nerfstudio", str(file)], views) == 0
    assert f"{new.name}: EXIF orientation: the photo is stored turned by 90 degrees" in caplog.text


@pytest.mark.slow
def test_a_matrix_of_the_whole_photo_does_not_fit_half_of_it(
    views: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """The size is not said; the principal point tells, and the doctor hears it."""
    file = write_nerfstudio(tmp_path / "a", views, Similarity())
    data = json.loads(file.read_text())
    for i, frame in enumerate(data["frames"]):
        del frame["w"], frame["h"]
        for folder in ("images", "backgrounds"):
            photo_file = tmp_path / "a" / folder / f"view_{i}.png"
            with Picture.open(photo_file) as picture:
                half = picture.resize((picture.width // 2, picture.height // 2), Picture.Resampling.BOX)
            half.save(photo_file)
    file.write_text(json.dumps(data))
    code = imported(tmp_path, ["nerfstudio", str(file)], views)
    assert code == 2 or cli.main(["doctor", str(tmp_path / "scene")]) == 1


@pytest.mark.parametrize(
    "more",
    [
        {"camera": {"model": "fisheye"}},
        {"camera_model": "EQUIRECTANGULAR"},
        {"k4": 0.1},
        {"scale": 0.5},
        {"transform_matrix": np.zeros((4, 4)).tolist()},
        {"intrinsics": "none", "fl_x": None},
    ],
    ids=lambda more: next(iter(more)),
)
def test_a_photo_that_is_not_wanted_is_not_judged(views: Views, tmp_path: Path, more: dict[str, Any]):
    file = write_nerfstudio(tmp_path / "a", views, Similarity())
    file = edited(file, lambda data: data["frames"][3].update(more))
    source = ["nerfstudio", str(file)]
    assert imported(tmp_path, [*source, "--views", "view_0", "view_1", "view_2"], views) == 0
    (tmp_path / "b").mkdir()
    assert imported(tmp_path / "b", source, views) == 2


@pytest.mark.parametrize("suffix", [".AVIF", ".heif", ".DNG", ".cr3", ".NEF", ".jxl"])
def test_photos_of_other_kinds_are_named_or_found_once_converted(
    views: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str], suffix: str
):
    file = write_nerfstudio(tmp_path / "a", views, Similarity())
    file.write_text(file.read_text().replace(".png", suffix))
    assert imported(tmp_path, ["nerfstudio", str(file)], views) == 0
    for folder in ("images", "backgrounds"):
        for photo in (tmp_path / "a" / folder).iterdir():
            photo.rename(photo.with_suffix(suffix))
    (tmp_path / "b").mkdir()
    assert imported(tmp_path / "b", ["nerfstudio", str(file)], views) == 2
    assert re.search("it holds (AVIF|HEIF|raw|JPEG XL) files, which are not read", capsys.readouterr().err)


def test_an_angle_of_view_holds_for_photos_of_every_size(views: Views, tmp_path: Path):
    """Of photos halved after the reconstruction, too."""
    file = write_nerfstudio(tmp_path / "a", views, Similarity())
    width, focal = views.frames[0].camera.width, views.frames[0].camera.intrinsics[0, 0]
    data = json.loads(file.read_text())
    for frame in data["frames"]:
        for key in ("fl_x", "fl_y", "cx", "cy", "w", "h"):
            del frame[key]
        frame["camera_angle_x"] = 2 * np.arctan(width / 2 / focal)
    file.write_text(json.dumps(data))
    for entry in read_transforms(file, lambda _: (width // 2, 60)):
        assert entry.read().lens.intrinsics[0, 0] == pytest.approx(focal / 2)


Y_UP = rigid([[1, 0, 0], [0, 0, 1], [0, -1, 0]])


@pytest.mark.parametrize(
    ("world", "words"),
    [(Y_UP, "its world has y up"), (inverse(Y_UP), "its world has z up")],
    ids=["of ARKit", "of Blender"],
)
def test_a_world_that_stands_on_another_axis_is_named(
    views: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str], world: Array, words: str
):
    def edit(data: dict[str, Any]) -> None:
        for frame in data["frames"]:
            frame["transform_matrix"] = (world @ np.array(frame["transform_matrix"])).tolist()

    file = edited(write_nerfstudio(tmp_path / "a", views, Similarity()), edit)
    alignment = tmp_path / "alignment.json"
    alignment.write_text(json.dumps({"world_from_workspace": np.eye(4).tolist()}))
    arguments = ["nerfstudio", str(file), "--alignment", str(alignment), "--out", str(tmp_path / "scene")]
    assert cli.main(["import", *arguments]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("write", [write_nerfstudio, write_robot], ids=["nerfstudio", "robot"])
def test_a_cube_that_stands_on_its_head_is_told(
    views: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str], write: Callable[..., Path]
):
    kind = "nerfstudio" if write is write_nerfstudio else "robot"
    source = (
        write(tmp_path / "a", views, Similarity()) if kind == "nerfstudio" else write(tmp_path / "a", views)
    )
    file = tmp_path / "alignment.json"
    cube = rigid(np.diag([1.0, -1, -1]), (0, 0.3, 0.1))
    file.write_text(json.dumps({"world_from_workspace": cube.tolist()}))
    assert (
        cli.main(["import", kind, str(source), "--alignment", str(file), "--out", str(tmp_path / "s")]) == 2
    )
    assert "all cameras lie below the table of the cube" in capsys.readouterr().err


def pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def dangling(file: Path) -> None:
    file.unlink()
    file.symlink_to("nowhere.png")


def as_gif(file: Path) -> None:
    Picture.open(file).save(file.with_suffix(".gif"))
    file.unlink()


@pytest.mark.parametrize("spoil", [pipe, dangling, as_gif])
@pytest.mark.parametrize("folder", ["images", "backgrounds"])
def test_a_photo_that_is_left_out_is_told(
    views: Views, tmp_path: Path, caplog: pytest.LogCaptureFixture, spoil: Callable[[Path], None], folder: str
):
    file = write_nerfstudio(tmp_path / "a", views, Similarity())
    spoil(next((tmp_path / "a" / folder).glob("*1.*")))
    assert imported(tmp_path, ["nerfstudio", str(file)], views) == 0
    assert f"{folder}: images/view_1.png left out: " in caplog.text


def test_a_photo_is_chosen_once(views: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = write_nerfstudio(tmp_path / "a", views, Similarity())
    assert imported(tmp_path, ["nerfstudio", str(file), "--views", "view_0", "view_0.png"], views) == 2
    assert "view_0.png is named twice" in capsys.readouterr().err
