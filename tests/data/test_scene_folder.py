"""Scenes on disk: what is written is read, and every mistake gets one error that says what would be right."""

from __future__ import annotations

import contextlib
import copy
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image as Picture

from neugrasp.data.scene_folder import read_scene, write_scene
from neugrasp.errors import InputError, WriteError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import from_quaternion, look_at
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import View, Views

Edit = Callable[[dict[str, Any]], None]


def edited(folder: Path, edit: Edit) -> Path:
    """The scene with its `scene.json` changed."""
    file = folder / "scene.json"
    data = json.loads(file.read_text())
    edit(data)
    file.write_text(json.dumps(data))
    return folder


def test_what_is_written_is_read(scene_folder: Path, small_views: Views):
    read = read_scene(scene_folder)
    assert len(read) == 4
    for view, original in zip(read.frames, small_views.frames, strict=True):
        np.testing.assert_array_equal(view.image, original.image)
        np.testing.assert_array_equal(view.background, original.background)
        np.testing.assert_array_equal(view.camera.intrinsics, original.camera.intrinsics)
        np.testing.assert_array_equal(view.camera.world_from_camera, original.camera.world_from_camera)
    assert read_scene(scene_folder / "scene.json").frames[0].name == "images/0.png"


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(
    st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.tuples(*[st.floats(-50, 50)] * 3),
    st.integers(1, 8),
    st.integers(32, 40),
    st.integers(32, 40),
    st.booleans(),
    st.integers(0, 2**32 - 1),
)
def test_any_scene_survives_the_disk(
    quaternion: tuple[float, ...],
    position: tuple[float, float, float],
    count: int,
    width: int,
    height: int,
    is_padded: bool,
    seed: int,
):
    rng = np.random.default_rng(seed)
    workspace = Workspace(world_from_workspace=from_quaternion(quaternion, position))
    intrinsics = np.array(
        [[width * rng.uniform(0.8, 2), 0, width / 2], [0, width * 1.1, height / 2], [0, 0, 1]]
    )
    views = []
    for _ in range(count):
        eye = workspace.centre + rng.uniform((-0.2, -0.2, 0.3), (0.2, 0.2, 0.5))
        pose = workspace.world_from_workspace @ look_at(eye, workspace.centre)
        sensed = (-0.5, rng.uniform(0, 5), width - 0.5, height - 1.5) if is_padded else None
        image, background = rng.integers(0, 256, size=(2, height, width, 3), dtype=np.uint8)
        views.append(View(Camera(intrinsics, pose, width, height, sensed), image, background))
    with tempfile.TemporaryDirectory() as folder:
        write_scene(Path(folder) / "s", Views(tuple(views), workspace))
        read = read_scene(Path(folder) / "s")
    np.testing.assert_array_equal(read.workspace.world_from_workspace, workspace.world_from_workspace)
    for view, original in zip(read.frames, views, strict=True):
        np.testing.assert_array_equal(view.image, original.image)
        assert view.camera.sensed == original.camera.sensed
        np.testing.assert_array_equal(view.camera.world_from_camera, original.camera.world_from_camera)


def test_a_scene_without_its_json_is_no_scene(scene_folder: Path):
    (scene_folder / "scene.json").unlink()
    with pytest.raises(InputError, match=r"scene\.json: missing; a scene is a folder with"):
        read_scene(scene_folder)


def test_a_missing_photo(scene_folder: Path):
    (scene_folder / "backgrounds/2.png").unlink()
    with pytest.raises(InputError, match=r"backgrounds/2\.png: missing; .*view 2 names it"):
        read_scene(scene_folder)


def test_photos_that_cannot_be_read(scene_folder: Path):
    photo = scene_folder / "images/1.png"
    whole = photo.read_bytes()
    for damaged in (b"", b"not a picture", whole[: len(whole) // 2], whole[:60]):
        photo.write_bytes(damaged)
        with pytest.raises(InputError, match=r"images/1\.png: .*view 1 needs a complete PNG or JPEG photo"):
            read_scene(scene_folder)


def test_a_depth_image_is_no_photo(scene_folder: Path):
    Picture.fromarray(np.full((36, 64), 500, dtype=np.uint16)).save(scene_folder / "images/0.png")
    with pytest.raises(InputError, match=r"images/0\.png: pixels of type I.* 8-bit RGB photo"):
        read_scene(scene_folder)


def test_a_background_of_another_size(scene_folder: Path):
    Picture.new("RGB", (32, 36)).save(scene_folder / "backgrounds/3.png")
    with pytest.raises(
        InputError, match=r"backgrounds/3\.png: background of 32 x 36 pixels, image of 64 x 36"
    ):
        read_scene(scene_folder)


@pytest.mark.parametrize(
    "name", ["../secret.png", "/etc/passwd", "images/../../x.png", "C:\\x.png", "", 3, None, "a\0b"]
)
def test_photos_outside_the_folder_are_not_read(scene_folder: Path, name: object):
    edited(scene_folder, lambda data: data["views"][0].update(image=name))
    with pytest.raises(
        InputError, match=r"view 0: .*(leaves the scene folder|must be the path|control characters)"
    ):
        read_scene(scene_folder)


def flipped(data: dict[str, Any]) -> None:
    for view in data["views"]:
        view["world_from_camera"] = (np.array(view["world_from_camera"]) @ np.diag([1, -1, -1, 1])).tolist()


def in_millimetres(data: dict[str, Any]) -> None:
    for view in data["views"]:
        for row in view["world_from_camera"][:3]:
            row[3] *= 1000


def one_pose(matrix: Callable[[np.ndarray], np.ndarray]) -> Edit:
    def edit(data: dict[str, Any]) -> None:
        view = data["views"][1]
        view["world_from_camera"] = matrix(np.array(view["world_from_camera"])).tolist()

    return edit


def one_camera(row: int, column: int, value: object) -> Edit:
    def edit(data: dict[str, Any]) -> None:
        data["views"][2]["intrinsics"][row][column] = value

    return edit


def workspace(**entries: object) -> Edit:
    return lambda data: data["workspace"].update(entries)


def views(count: int) -> Edit:
    def edit(data: dict[str, Any]) -> None:
        data["views"] = [copy.deepcopy(data["views"][0]) for _ in range(count)]

    return edit


MISTAKES: dict[str, tuple[Edit, str]] = {
    "zero views": (views(0), r"scene\.json: 0 views given; a scene has 1 to 8 views"),
    "nine views": (views(9), r"scene\.json: 9 views given; a scene has 1 to 8 views"),
    "views no list": (lambda data: data.update(views={}), "'views' must be a list"),
    "a view of text": (lambda data: data.update(views=["a"]), "view 0: must be an object"),
    "another format": (lambda data: data.update(format="nerf"), 'not a scene; it must be .*"neugrasp-scene"'),
    "newer version": (
        lambda data: data.update(version=2),
        "version 2 is newer than this program, which reads 1",
    ),
    "no version": (lambda data: data.pop("version"), "unknown scene version None"),
    "no workspace": (lambda data: data.pop("workspace"), "'workspace' must be an object"),
    "size in millimetres": (
        workspace(size=300),
        "300 m .that looks like millimetres.; it must be the edge of the cube in metres, for .* 0.30",
    ),
    "other size": (workspace(size=5), "workspace size 5 m; it must be the edge"),
    "workspace scaled": (
        workspace(world_from_workspace=np.diag([2.0, 2, 2, 1]).tolist()),
        "world_from_workspace: not a rigid transform: it scales by 2",
    ),
    "millimetres": (in_millimetres, "view 0: camera .* from the workspace; the poses look like millimetres"),
    "OpenGL": (flipped, r"workspace is outside every view; the poses look like OpenGL.*diag\(1, -1, -1, 1\)"),
    "mirrored": (one_pose(lambda pose: pose @ np.diag([1, 1, -1, 1])), "view 1: .*left-handed"),
    "scaled": (one_pose(lambda pose: pose @ np.diag([3, 3, 3, 1])), "view 1: .*it scales by 3"),
    "sheared": (one_pose(lambda pose: pose + np.eye(4, k=1) * 0.1), "view 1: .*not a rotation"),
    "transposed": (one_pose(np.transpose), "view 1: .*last row"),
    "3 x 4": (one_pose(lambda pose: pose[:3]), "view 1: world_from_camera: .*4 x 4 numbers"),
    "NaN pose": (one_pose(lambda pose: pose * np.nan), "view 1: world_from_camera: contains NaN"),
    "no pose": (lambda data: data["views"][1].pop("world_from_camera"), "view 1: world_from_camera: missing"),
    "focal in words": (one_camera(0, 0, "60.0"), "view 2: intrinsics: of another shape or type"),
    "focal true": (one_camera(0, 1, False), "view 2: intrinsics: of another shape or type"),
    "focal zero": (one_camera(0, 0, 0.0), "view 2: intrinsics: focal lengths 0 and .* must be positive"),
    "focal negative": (one_camera(1, 1, -40.0), "view 2: intrinsics: .*must be positive"),
    "normalised": (one_camera(0, 0, 0.7), "view 2: intrinsics: .*too short"),
    "unequal": (one_camera(1, 1, 300.0), "view 2: intrinsics: .*differ too much"),
    "skew": (one_camera(0, 1, 5.0), "view 2: intrinsics: skew 5 is not 0"),
    "below": (one_camera(1, 0, 5.0), "view 2: intrinsics: not a camera matrix"),
    "last row": (one_camera(2, 2, 2.0), "view 2: intrinsics: not a camera matrix"),
    "principal point": (one_camera(0, 2, 640.0), r"view 2: intrinsics: principal point .* far outside"),
    "NaN intrinsics": (one_camera(0, 0, float("nan")), "view 2: intrinsics: contains NaN"),
    "infinite intrinsics": (one_camera(0, 2, float("inf")), "view 2: intrinsics: contains NaN or infinity"),
    "empty part": (
        lambda data: data["views"][0].update(sensed=[5, 0, 5, 9]),
        "view 0: sensed: an empty part",
    ),
    "part elsewhere": (lambda data: data["views"][0].update(sensed=[99, 0, 120, 9]), "view 0: sensed"),
    "part of three": (lambda data: data["views"][0].update(sensed=[1, 2, 3]), "view 0: sensed: .*4 numbers"),
    "workspace elsewhere": (
        workspace(world_from_workspace=(np.eye(4) + 3 * np.eye(4, k=3)).tolist()),
        "workspace is outside every view; .*world_from_workspace is probably wrong",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_every_mistake_says_where_it_is_and_what_would_be_right(scene_folder: Path, name: str):
    edit, message = MISTAKES[name]
    edited(scene_folder, edit)
    with pytest.raises(InputError, match=message) as caught:
        read_scene(scene_folder)
    assert "scene.json" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '"x"', "\xff"])
def test_what_is_not_json(scene_folder: Path, text: str):
    (scene_folder / "scene.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"scene\.json: (not valid JSON|not a scene|no text in UTF-8)"):
        read_scene(scene_folder)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 3) | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(["format", "version", "workspace", "views", "size", "world_from_workspace"])
    | st.sampled_from(["image", "background", "intrinsics", "world_from_camera", "sensed"]),
    json_values,
)
def test_no_content_ends_in_anything_but_a_scene_or_an_input_error(
    tmp_path_factory: pytest.TempPathFactory, key: str, value: object
):
    folder = tmp_path_factory.getbasetemp() / "fuzzed"
    if not folder.exists():
        pose = look_at((0.15, -0.2, 0.5), (0.15, 0.15, 0.05))
        camera = Camera(np.array([[30.0, 0, 16], [0, 30, 16], [0, 0, 1]]), pose, 32, 32)
        photo = np.zeros((32, 32, 3), dtype=np.uint8)
        write_scene(folder, Views((View(camera, photo, photo),), Workspace()))
    file = folder / "scene.json"
    original = file.read_text()
    data = json.loads(original)
    owner = data if key in data else data["workspace"] if key in data["workspace"] else data["views"][0]
    owner[key] = value
    file.write_text(json.dumps(data))
    with contextlib.suppress(InputError):
        read_scene(folder)
    file.write_text(original)


def test_a_view_that_misses_the_workspace_is_reported_but_allowed(
    scene_folder: Path, caplog: pytest.LogCaptureFixture
):
    edited(scene_folder, one_pose(lambda pose: pose @ np.diag([1.0, -1, -1, 1])))
    assert len(read_scene(scene_folder)) == 4
    assert "view 1: the workspace is outside this view" in caplog.text


def test_writing_a_scene_leaves_no_scene_behind_when_the_disk_is_full(
    tmp_path: Path, small_views: Views, monkeypatch: pytest.MonkeyPatch
):
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(WriteError, match=r"scene\.json: cannot be written \(No space left"):
        write_scene(tmp_path / "scene", small_views)
    assert not (tmp_path / "scene" / "scene.json").exists()


@pytest.mark.parametrize(
    ("place", "more", "message"),
    [
        (
            "view",
            {"distortion": [-0.2, 0, 0, 0, 0]},
            "view 1: 'distortion' is a coefficient of lens distortion",
        ),
        ("view", {"dist_coeffs": [[0.1]]}, "view 1: 'dist_coeffs'"),
        ("view", {"k1": -0.1}, "view 1: 'k1'"),
        ("view", {"camera_model": "OPENCV_FISHEYE"}, "view 1: 'camera_model' is a lens that is no pinhole"),
        ("view", {"rolling_shutter": [0, 0, 0.1, 0]}, "view 1: 'rolling_shutter'"),
        ("scene", {"D": [0.1, 0, 0, 0, 0]}, "'D' is a coefficient of lens distortion"),
        ("scene", {"applied_scale": 0.8}, "'applied_scale' is a scale or a motion of the poses"),
        ("scene", {"units": "mm"}, "'units' is a unit of length"),
        ("workspace", {"scale": 0.5}, "workspace: 'scale'"),
    ],
)
def test_a_key_that_bends_geometry_is_refused(scene_folder: Path, place: str, more: dict, message: str):
    def edit(data: dict[str, Any]) -> None:
        {"scene": data, "workspace": data["workspace"], "view": data["views"][1]}[place].update(more)

    edited(scene_folder, edit)
    with pytest.raises(InputError, match=rf"scene\.json.*{message}.*neugrasp import robot"):
        read_scene(scene_folder)


def test_a_key_that_bends_nothing_passes_and_a_misspelt_one_is_told(
    scene_folder: Path, caplog: pytest.LogCaptureFixture
):
    edited(scene_folder, lambda data: data["views"][0].update(distortion=[0.0] * 5, camera_model="PINHOLE"))
    edited(scene_folder, lambda data: [view.update(sensd=[0, 0, 30, 30]) for view in data["views"]])
    assert len(read_scene(scene_folder)) == 4
    told = [record.getMessage() for record in caplog.records if "'sensd'" in record.getMessage()]
    assert len(told) == 1
    assert "did you mean 'sensed'?" in told[0]


@pytest.mark.parametrize("key", ["width", "image_width", "W", "h", "imageHeight"])
def test_a_size_that_is_not_the_photos_is_refused(scene_folder: Path, key: str):
    height, width = read_scene(scene_folder).frames[0].image.shape[:2]
    right = width if "w" in key.lower() else height
    with pytest.raises(InputError, match=f"view 0: {key!r} is {2 * right}, the photo has {width} x {height}"):
        read_scene(edited(scene_folder, lambda data: data["views"][0].update({key: 2 * right})))
    read_scene(edited(scene_folder, lambda data: data["views"][0].update({key: right})))


def test_links_that_leave_the_folder_are_refused(scene_folder: Path, tmp_path: Path):
    elsewhere = tmp_path / "elsewhere"
    (scene_folder / "images").rename(elsewhere)
    (scene_folder / "images").symlink_to(elsewhere)
    with pytest.raises(InputError, match=r"view 0: image 'images/0\.png' is a link that leaves the"):
        read_scene(scene_folder)
    (scene_folder / "images").unlink()
    elsewhere.rename(scene_folder / "images")
    (scene_folder / "images/1.png").rename(scene_folder / "kept.png")
    (scene_folder / "images/1.png").symlink_to("../kept.png")
    (scene_folder / "images/2.png").rename(tmp_path / "2.png")
    (scene_folder / "images/2.png").symlink_to(tmp_path / "2.png")
    with pytest.raises(InputError, match=r"view 2: image 'images/2\.png' is a link that leaves"):
        read_scene(scene_folder)
    (tmp_path / "2.png").rename(scene_folder / "2.png")
    (scene_folder / "images/2.png").unlink()
    (scene_folder / "images/2.png").symlink_to("../2.png")
    (tmp_path / "linked").symlink_to(scene_folder)
    assert len(read_scene(tmp_path / "linked")) == 4


@pytest.mark.timeout(20)
def test_a_pipe_is_no_scene_and_no_photo(scene_folder: Path):
    (scene_folder / "images/0.png").unlink()
    os.mkfifo(scene_folder / "images/0.png")
    with pytest.raises(InputError, match=r"images/0\.png: is a pipe, .* only regular files are read"):
        read_scene(scene_folder)
    (scene_folder / "scene.json").unlink()
    os.mkfifo(scene_folder / "scene.json")
    with pytest.raises(InputError, match=r"scene\.json: is a pipe"):
        read_scene(scene_folder)


def test_names_written_on_windows_are_read(scene_folder: Path, small_views: Views):
    edited(scene_folder, lambda data: data["views"][0].update(image="images\\0.png"))
    np.testing.assert_array_equal(read_scene(scene_folder).frames[0].image, small_views.frames[0].image)


def test_the_mark_of_byte_order_is_read_and_double_keys_are_not(scene_folder: Path):
    file = scene_folder / "scene.json"
    text = file.read_text()
    file.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert len(read_scene(scene_folder)) == 4
    file.write_text(text.replace('"version": 1', '"version": 99, "version": 1'))
    with pytest.raises(InputError, match=r"scene\.json: not valid JSON \(the key 'version' is given twice"):
        read_scene(scene_folder)


@pytest.mark.parametrize("part", [[5, 5, 5.0001, 30], [0, 0, 7, 30], [60, 0, 200, 30]])
def test_a_part_too_small_to_look_at_is_refused(scene_folder: Path, part: list[float]):
    edited(scene_folder, lambda data: data["views"][0].update(sensed=part))
    with pytest.raises(InputError, match="view 0: sensed: an empty part, or one of less than 8 pixels"):
        read_scene(scene_folder)


def test_numbers_beyond_all_measure_are_refused_without_a_warning(scene_folder: Path):
    edited(scene_folder, one_pose(lambda pose: pose + 1e308))
    with pytest.raises(InputError, match=r"view 1: world_from_camera: .* is no length and no pixel"):
        read_scene(scene_folder)
