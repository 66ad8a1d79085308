"""What comes in from other formats is the scene that was written in them, or an error with its name."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from foreign_formats import (
    ARBITRARY,
    Similarity,
    whole_photos,
    write_colmap,
    write_nerfstudio,
    write_photos,
    write_robot,
)
from neugrasp import cli
from neugrasp.data.scene_folder import read_scene
from neugrasp.errors import InputError
from neugrasp.geometry.pose import rigid, rotation_about
from neugrasp.geometry.workspace import Workspace
from neugrasp.importers.robot_poses import read_robot
from neugrasp.observation import Views

Write = Callable[[Path, Views], list[str]]


def nerfstudio(folder: Path, views: Views) -> list[str]:
    source = write_nerfstudio(folder, views, ARBITRARY)
    return ["nerfstudio", str(source), "--alignment", str(ARBITRARY.write(folder / "alignment.json", views))]


def colmap_text(folder: Path, views: Views) -> list[str]:
    source = write_colmap(folder, views, ARBITRARY, is_binary=False)
    return ["colmap", str(source), "--alignment", str(ARBITRARY.write(folder / "alignment.json", views))]


def colmap_binary(folder: Path, views: Views) -> list[str]:
    source = write_colmap(folder, views, ARBITRARY, is_binary=True)
    return ["colmap", str(source), "--alignment", str(ARBITRARY.write(folder / "alignment.json", views))]


def robot(folder: Path, views: Views) -> list[str]:
    source = write_robot(folder, views)
    return ["robot", str(source), "--alignment", str(Similarity().write(folder / "alignment.json", views))]


def robot_csv(folder: Path, views: Views) -> list[str]:
    source = write_robot(folder, views, is_csv=True)
    return ["robot", str(source), "--alignment", str(Similarity().write(folder / "alignment.json", views))]


def ur(folder: Path, views: Views) -> list[str]:
    source = write_robot(folder, views, is_ur=True)
    return ["robot", str(source), "--alignment", str(Similarity().write(folder / "alignment.json", views))]


def ur_csv(folder: Path, views: Views) -> list[str]:
    source = write_robot(folder, views, is_ur=True, is_csv=True)
    return ["robot", str(source), "--alignment", str(Similarity().write(folder / "alignment.json", views))]


@pytest.fixture
def elsewhere(small_views: Views) -> Views:
    """Four views of one lens in a world whose cube is turned and far from the origin."""
    place = rigid(rotation_about((0, 0, 1), 0.6), (1.0, -2.0, 0.3))
    views = []
    for view in small_views.frames:
        camera = replace(view.camera.moved(place), sensed=None)
        views.append(replace(view, camera=camera))
    return Views(tuple(views), Workspace(world_from_workspace=place))


def same(one: Views, other: Views) -> None:
    np.testing.assert_allclose(
        one.workspace.world_from_workspace, other.workspace.world_from_workspace, atol=1e-12
    )
    assert len(one) == len(other)
    for mine, yours in zip(one.frames, other.frames, strict=True):
        assert np.array_equal(mine.image, yours.image)
        assert np.array_equal(mine.background, yours.background)
        np.testing.assert_allclose(mine.camera.intrinsics, yours.camera.intrinsics, atol=1e-9)
        np.testing.assert_allclose(mine.camera.world_from_camera, yours.camera.world_from_camera, atol=1e-9)
        assert mine.camera.sensed == yours.camera.sensed


@pytest.mark.slow
@pytest.mark.parametrize("write", [nerfstudio, colmap_text, colmap_binary, robot, robot_csv, ur, ur_csv])
def test_a_scene_comes_back_from_every_format(
    write: Write, elsewhere: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    arguments = write(tmp_path / "foreign", elsewhere)
    assert cli.main(["import", *arguments, "--out", str(tmp_path / "scene")]) == 0
    same(read_scene(tmp_path / "scene"), elsewhere)
    assert sorted(file.name for file in (tmp_path / "scene").iterdir()) == [
        "backgrounds",
        "images",
        "scene.json",
    ]
    assert "4 views in" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_grasps_are_those_of_the_original(tmp_path: Path):
    """The promise of the importers: the same grasps within 1e-4, in the same world."""
    from neugrasp.demo.bundled import demo_scenes
    from neugrasp.detection.detector import NeuGraspDetector

    detector = NeuGraspDetector.load("neugrasp")
    original = whole_photos(read_scene(demo_scenes()[0].folder))
    expected = detector.detect(original).grasps
    assert len(expected) > 3
    for write in (nerfstudio, colmap_text, colmap_binary):
        arguments = write(tmp_path / write.__name__, original)
        out = tmp_path / f"{write.__name__}_scene"
        assert cli.main(["import", *arguments, "--out", str(out)]) == 0
        found = detector.detect(read_scene(out)).grasps
        assert len(found) == len(expected)
        for mine, yours in zip(found, expected, strict=True):
            np.testing.assert_allclose(mine.pose, yours.pose, atol=1e-4)
            assert abs(mine.width - yours.width) < 1e-4
            assert abs(mine.score - yours.score) < 1e-4


def test_photos_are_chosen_by_name_and_kept_in_that_order(elsewhere: Views, tmp_path: Path):
    arguments = nerfstudio(tmp_path / "foreign", elsewhere)
    chosen = ["--views", "view_2", "view_0.png"]
    assert cli.main(["import", *arguments, *chosen, "--out", str(tmp_path / "scene")]) == 0
    views = (elsewhere.frames[2], elsewhere.frames[0])
    same(read_scene(tmp_path / "scene"), replace(elsewhere, frames=views))


def test_only_photos_with_a_background_are_used(elsewhere: Views, tmp_path: Path):
    arguments = colmap_binary(tmp_path / "foreign", elsewhere)
    backgrounds = tmp_path / "empty_table"
    (tmp_path / "foreign/backgrounds").rename(backgrounds)
    for i in (0, 3):
        (backgrounds / f"view_{i}.png").unlink()
    # Another suffix is the same photo.
    Picture.open(backgrounds / "view_1.png").save(backgrounds / "view_1.PNG")
    (backgrounds / "view_1.png").unlink()
    more = ["--backgrounds", str(backgrounds), "--out", str(tmp_path / "scene")]
    assert cli.main(["import", *arguments, *more]) == 0
    same(read_scene(tmp_path / "scene"), replace(elsewhere, frames=elsewhere.frames[1:3]))


def broken(kind: str, folder: Path, views: Views) -> list[str]:
    """Arguments of an import that cannot work."""
    arguments = nerfstudio(folder, views)
    file = folder / "transforms.json"
    data = json.loads(file.read_text())
    if kind == "no alignment":
        arguments = arguments[:2]
    elif kind == "two alignments":
        arguments += ["--board", "default"]
    elif kind == "no backgrounds":
        arguments += ["--backgrounds", str(folder / "none")]
    elif kind == "other names":
        for photo in (folder / "backgrounds").iterdir():
            photo.rename(photo.with_name("empty_" + photo.name))
    elif kind == "no such view":
        arguments += ["--views", "view_9"]
    elif kind == "no such source":
        arguments[1] = str(folder / "none.json")
    elif kind == "no json":
        file.write_text("{")
    elif kind == "fisheye":
        data["camera_model"] = "OPENCV_FISHEYE"
    elif kind == "k4":
        data["k4"] = 0.1
    elif kind == "no pose":
        del data["frames"][1]["transform_matrix"]
    elif kind == "scaled pose":
        data["frames"][1]["transform_matrix"][0] = [2.0, 0, 0, 0]
    elif kind == "no frames":
        data["frames"] = []
    elif kind == "other size":
        data["frames"][2]["w"] = 96
    elif kind == "on its side":
        data["frames"][2]["w"], data["frames"][2]["h"] = data["frames"][2]["h"], data["frames"][2]["w"]
    elif kind == "no focal length":
        del data["frames"][0]["fl_x"], data["frames"][0]["fl_y"]
    elif kind == "OpenCV axes":
        for frame in data["frames"]:
            frame["transform_matrix"] = (
                np.array(frame["transform_matrix"]) @ np.diag([1, -1, -1, 1])
            ).tolist()
    elif kind == "same file twice":
        data["frames"][1]["file_path"] = "other/view_0.png"
    if kind != "no json":
        file.write_text(json.dumps(data))
    return arguments


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("no alignment", "where is the cube"),
        ("two alignments", "where is the cube"),
        ("no backgrounds", "none: no such folder"),
        ("other names", "has a background of the same name"),
        ("no such view", "--views view_9: no photo of that name; there are images/view_0.png"),
        ("no such source", r"none.json: missing"),
        ("no json", r"transforms.json: not valid JSON"),
        ("fisheye", "frame 0: camera_model 'OPENCV_FISHEYE' cannot be undistorted"),
        ("k4", "frame 0: k4 cannot be undistorted"),
        ("no pose", "frame 1: transform_matrix: missing"),
        ("scaled pose", "frame 1: transform_matrix: not a rigid transform"),
        ("no frames", "'frames' must be a list"),
        ("other size", "view_2.png: 64 x 36 pixels; its camera was calibrated for 96 x 36"),
        ("on its side", "lies on its side"),
        ("no focal length", "frame 0: no focal length"),
        ("OpenCV axes", "transform_matrix holds OpenCV axes (x right, y down, z forward)"),
        ("same file twice", "view_0.png: stands for both"),
    ],
)
def test_a_mistake_is_named_and_nothing_is_written(
    kind: str, message: str, elsewhere: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    arguments = broken(kind, tmp_path / "foreign", elsewhere)
    assert cli.main(["import", *arguments, "--out", str(tmp_path / "scene")]) == 2
    error = capsys.readouterr().err
    assert "neugrasp: error: " in error
    assert message in error
    assert not (tmp_path / "scene").exists()


def test_a_folder_in_use_is_left_alone(elsewhere: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "scene"
    out.mkdir()
    (out / "mine.txt").write_text("mine")
    assert cli.main(["import", *nerfstudio(tmp_path / "foreign", elsewhere), "--out", str(out)]) == 2
    assert "not empty; name a new folder" in capsys.readouterr().err
    assert [file.name for file in out.iterdir()] == ["mine.txt"]


def test_the_size_of_photos_is_found_where_the_file_does_not_say(elsewhere: Views, tmp_path: Path):
    """As in the files of the synthetic NeRF scenes: no w and h, an angle, names without a suffix."""
    arguments = nerfstudio(tmp_path / "foreign", elsewhere)
    file = tmp_path / "foreign/transforms.json"
    data = json.loads(file.read_text())
    camera = elsewhere.frames[0].camera
    data["camera_angle_x"] = 2 * np.arctan(camera.width / 2 / camera.intrinsics[0, 0])
    for frame in data["frames"]:
        frame["file_path"] = frame["file_path"].removesuffix(".png")
        for key in ("fl_x", "fl_y", "w", "h"):
            del frame[key]
    file.write_text(json.dumps(data))
    assert cli.main(["import", *arguments, "--out", str(tmp_path / "scene")]) == 0
    same(read_scene(tmp_path / "scene"), elsewhere)


def test_more_than_eight_views_are_refused(
    elsewhere: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    folder = tmp_path / "foreign"
    arguments = nerfstudio(folder, elsewhere)
    data = json.loads((folder / "transforms.json").read_text())
    data["frames"] = [{**data["frames"][i % 4], "file_path": f"images/view_{i}.png"} for i in range(12)]
    (folder / "transforms.json").write_text(json.dumps(data))
    for i in range(4, 12):
        for kind in ("images", "backgrounds"):
            Picture.open(folder / kind / f"view_{i % 4}.png").save(folder / kind / f"view_{i}.png")
    assert cli.main(["import", *arguments, "--out", str(tmp_path / "scene")]) == 2
    assert "12 photos have a background; choose up to 8 of them with --views" in capsys.readouterr().err


def test_a_background_without_a_pose_is_told(
    elsewhere: Views, tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    arguments = nerfstudio(tmp_path / "foreign", elsewhere)
    views = tuple(elsewhere.frames[i % 4] for i in range(5))
    write_photos(tmp_path / "foreign", replace(elsewhere, frames=views))
    assert cli.main(["import", *arguments, "--out", str(tmp_path / "scene")]) == 0
    assert "no pose is known for view_4.png" in caplog.text


def test_only_the_cameras_of_chosen_photos_are_judged(elsewhere: Views, tmp_path: Path):
    """A capture may hold photos of a fisheye lens, poses that failed, and photos that are not there."""
    arguments = nerfstudio(tmp_path / "foreign", elsewhere)
    file = tmp_path / "foreign/transforms.json"
    data = json.loads(file.read_text())
    data["frames"][0].update(camera_model="OPENCV_FISHEYE", k1=0.02)
    data["frames"][2].update(transform_matrix="none", file_path="images/gone.png")
    file.write_text(json.dumps(data))
    chosen = ["--views", "view_1", "view_3"]
    assert cli.main(["import", *arguments, *chosen, "--out", str(tmp_path / "scene")]) == 0
    same(read_scene(tmp_path / "scene"), replace(elsewhere, frames=elsewhere.frames[1::2]))


@pytest.mark.parametrize(
    "kind", ["absolute", "upwards", "backslashes", "drive", "capitals", "HEIC", "no suffix"]
)
def test_names_of_other_systems_lead_to_their_photos(elsewhere: Views, tmp_path: Path, kind: str):
    arguments = nerfstudio(tmp_path / "foreign", elsewhere)
    file = tmp_path / "foreign/transforms.json"
    data = json.loads(file.read_text())
    for i, frame in enumerate(data["frames"]):
        frame["file_path"] = {
            "absolute": str((tmp_path / f"foreign/images/view_{i}.png").resolve()),
            "upwards": f"./../foreign/images/view_{i}.png",
            "backslashes": f".\\images\\view_{i}.png",
            "drive": f"C:\\shots\\images\\view_{i}.png",
            "capitals": f"images/VIEW_{i}.PNG",
            "HEIC": f"images/view_{i}.HEIC",
            "no suffix": f"images/view_{i}",
        }[kind]
    file.write_text(json.dumps(data))
    assert cli.main(["import", *arguments, "--out", str(tmp_path / "scene")]) == 0
    same(read_scene(tmp_path / "scene"), elsewhere)


def test_photos_of_a_kind_that_is_not_read_are_named(
    elsewhere: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    arguments = nerfstudio(tmp_path / "foreign", elsewhere)
    for kind in ("images", "backgrounds"):
        for photo in (tmp_path / "foreign" / kind).iterdir():
            photo.rename(photo.with_suffix(".heic"))
    for chosen in ([], ["--views", "view_1"]):
        assert cli.main(["import", *arguments, *chosen, "--out", str(tmp_path / "scene")]) == 2
        assert "it holds HEIC files, which are not read; convert photos and backg" in capsys.readouterr().err


def test_backgrounds_in_folders_of_a_rig_are_found(elsewhere: Views, tmp_path: Path):
    arguments = colmap_binary(tmp_path / "foreign", elsewhere)
    model = tmp_path / "foreign/sparse/0/images.bin"
    data = model.read_bytes()
    for i in range(4):
        data = data.replace(f"view_{i}.png".encode(), f"rig/cam{i}/0.png".encode())
        for kind in ("images", "backgrounds"):
            folder = tmp_path / "foreign" / kind / f"rig/cam{i}"
            folder.mkdir(parents=True)
            (tmp_path / "foreign" / kind / f"view_{i}.png").rename(folder / "0.png")
    model.write_bytes(data)
    assert cli.main(["import", *arguments, "--out", str(tmp_path / "scene")]) == 0
    same(read_scene(tmp_path / "scene"), elsewhere)


@pytest.mark.parametrize("value", [3, 6, 8])
def test_an_orientation_tag_is_told_at_import(
    elsewhere: Views, tmp_path: Path, caplog: pytest.LogCaptureFixture, value: int
):
    arguments = nerfstudio(tmp_path / "foreign", elsewhere)
    file = tmp_path / "foreign/images/view_2.png"
    with Picture.open(file) as picture:
        tags = picture.getexif()
        tags[274] = value
        picture.save(file, exif=tags)
    assert cli.main(["import", *arguments, "--out", str(tmp_path / "scene")]) == 0
    assert "view_2.png: EXIF orientation: the photo is stored turned by" in caplog.text
    assert "view_1.png: EXIF" not in caplog.text
    same(read_scene(tmp_path / "scene"), elsewhere)


@pytest.mark.parametrize(("factor", "is_told"), [(2, True), (0.5, True), (1.1, False)])
def test_another_focal_length_is_told_at_import(
    elsewhere: Views, tmp_path: Path, caplog: pytest.LogCaptureFixture, factor: float, is_told: bool
):
    arguments = nerfstudio(tmp_path / "foreign", elsewhere)
    camera = elsewhere.frames[2].camera
    film = camera.intrinsics[0, 0] * np.hypot(36, 24) / np.hypot(camera.width, camera.height)
    file = tmp_path / "foreign/images/view_2.png"
    with Picture.open(file) as picture:
        tags = picture.getexif()
        tags[0x8769] = {0xA405: round(factor * film)}
        picture.save(file, exif=tags)
    assert cli.main(["import", *arguments, "--out", str(tmp_path / "scene")]) == 0
    assert ("view_2.png: EXIF focal length" in caplog.text) is is_told
    same(read_scene(tmp_path / "scene"), elsewhere)


@pytest.mark.parametrize(
    ("more", "message"),
    [({"scale": 0.25}, "'scale' is a scale or a motion"), ({"units": "mm"}, "'units' is a unit of length")],
)
def test_an_alignment_that_is_not_understood_is_refused(
    elsewhere: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: dict, message: str
):
    arguments = nerfstudio(tmp_path / "foreign", elsewhere)
    file = tmp_path / "foreign/alignment.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **more}))
    assert cli.main(["import", *arguments, "--out", str(tmp_path / "scene")]) == 2
    assert f"alignment.json: {message}" in capsys.readouterr().err


def test_a_scale_in_the_file_wants_one_in_the_alignment(
    elsewhere: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    arguments = nerfstudio(tmp_path / "foreign", elsewhere)
    for file, edit in (("transforms", {"applied_scale": 0.8}), ("alignment", {})):
        path = tmp_path / f"foreign/{file}.json"
        data = {**json.loads(path.read_text()), **edit}
        if file == "alignment":
            del data["metres_per_unit"]
        path.write_text(json.dumps(data))
    assert cli.main(["import", *arguments, "--out", str(tmp_path / "scene")]) == 2
    assert "transforms.json: applied_scale 0.8" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("image,x,y,z,qx,qy,qz,qw,x\na,0,0,0,0,0,0,1,2\n", "the column 'x' is there twice"),
        ("image,x,y,z,qx,qy,qz,qw\na,0,0,0,0,0,0\n", "line 2: has more or fewer cells"),
        ("image,x,y,z,qx,qy,qz,qw\na,0,0,0,0,0,0,1,9\n", "line 2: has more or fewer cells"),
        ("image,x_mm,x,y,z,qx,qy,qz,qw\na,0,0,0,0,0,0,0,1\n", "'x_mm' is a unit of length"),
    ],
)
def test_a_csv_file_that_is_not_understood_is_refused(
    tmp_path: Path, elsewhere: Views, text: str, message: str
):
    file = write_robot(tmp_path, elsewhere, is_csv=True)
    (tmp_path / "poses.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_robot(file)


def test_a_view_of_the_robot_may_have_a_lens_of_its_own(tmp_path: Path, elsewhere: Views):
    file = write_robot(tmp_path, elsewhere)
    data = json.loads(file.read_text())
    data["views"][1].update(D=[0.1, 0, 0, 0, 0], fl_x=61.0)
    file.write_text(json.dumps(data))
    posed_images = [entry.read() for entry in read_robot(file)]
    assert posed_images[1].lens.radial[0] == 0.1
    assert posed_images[1].lens.intrinsics[0, 0] == 61
    assert not posed_images[0].lens.is_distorted


@pytest.mark.parametrize("chosen", [[], ["--views", "view_0", "view_1"]])
def test_a_photo_with_two_poses_is_refused(
    elsewhere: Views, tmp_path: Path, capsys: pytest.CaptureFixture[str], chosen: list[str]
):
    arguments = nerfstudio(tmp_path / "foreign", elsewhere)
    file = tmp_path / "foreign/transforms.json"
    data = json.loads(file.read_text())
    data["frames"].append({**data["frames"][2], "file_path": data["frames"][0]["file_path"]})
    file.write_text(json.dumps(data))
    assert cli.main(["import", *arguments, *chosen, "--out", str(tmp_path / "scene")]) == 2
    assert (
        "the photo images/view_0.png is there twice; which of its poses is meant?" in capsys.readouterr().err
    )
