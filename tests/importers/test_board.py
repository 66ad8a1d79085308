"""A printed board says where cameras and cube are, as exactly as a grasp needs it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from foreign_formats import ARBITRARY, write_colmap, write_robot
from neugrasp import cli
from neugrasp.data.scene_folder import read_scene
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.lens import Lens
from neugrasp.geometry.pose import Array, inverse, rigid, rotation_about
from neugrasp.importers.board import Board, Tag, Tags
from neugrasp.importers.board_file import read_board
from neugrasp.observation import View, Views

pytest.importorskip("cv2")

from neugrasp.importers.board_page import PAPERS, sheet
from neugrasp.importers.markers import calibrate, find_board
from table_photos import camera_at, photo_of_table

TARGET = np.array([0.126, 0.25, 0.0])
EYES = np.array([(-0.1, -0.35, 0.50), (0.10, -0.30, 0.62), (0.42, -0.2, 0.50)])
TAGS = {
    "kind": "tags",
    "tags": [
        {"id": 3, "size": 0.06, "centre": [0.03, 0.03]},
        {"id": 11, "size": 0.06, "centre": [0.22, 0.05], "turn_deg": 30},
        {"id": 20, "size": 0.08, "centre": [0.12, 0.13], "turn_deg": -90},
    ],
}


@pytest.fixture(scope="module")
def board() -> Board:
    return Board()


@pytest.fixture(scope="module")
def cameras() -> list[Camera]:
    return [camera_at(eye, TARGET) for eye in EYES]


@pytest.fixture(scope="module")
def photos(board: Board, cameras: list[Camera]) -> list[np.ndarray]:
    return [photo_of_table(board, camera) for camera in cameras]


def apart(one: Array, other: Array) -> tuple[float, float]:
    """Millimetres and degrees between two poses."""
    turn = np.trace(one[:3, :3].T @ other[:3, :3])
    return (
        1000 * float(np.linalg.norm(one[:3, 3] - other[:3, 3])),
        float(np.rad2deg(np.arccos(np.clip((turn - 1) / 2, -1, 1)))),
    )


def views_of(photos: Sequence[np.ndarray], cameras: Sequence[Camera], board: Board) -> Views:
    """Scenes in which nothing stands on the table."""
    views = [View(camera, photo, photo) for photo, camera in zip(photos, cameras, strict=True)]
    return Views(tuple(views), board.workspace())


@pytest.mark.slow
def test_the_camera_is_found_from_one_photo(board: Board, cameras: list[Camera], photos: list[np.ndarray]):
    for camera, photo in zip(cameras, photos, strict=True):
        sighting = find_board(board, photo, Lens(camera.intrinsics, camera.width, camera.height))
        assert sighting is not None
        assert sighting.num_points == 24
        millimetres, degrees = apart(inverse(sighting.camera_from_board), camera.world_from_camera)
        assert millimetres < 1
        assert degrees < 0.1
        assert sighting.error < 0.3


@pytest.mark.slow
def test_corners_lie_on_average_where_the_camera_sees_them(
    board: Board, cameras: list[Camera], photos: list[np.ndarray]
):
    """A shift of half a pixel, by another idea of where a pixel's centre is, would show."""
    import cv2

    from neugrasp.importers import markers

    for camera, photo in zip(cameras, photos, strict=True):
        found = markers._corners(cv2, board, photo)
        assert found is not None
        shift = found[1] - camera.project(found[0])[0]
        assert np.abs(shift.mean(axis=0)).max() < 0.05
        assert np.abs(shift).max() < 0.5


@pytest.mark.slow
def test_a_bent_photo_gives_the_same_camera(board: Board, cameras: list[Camera]):
    camera = cameras[0]
    lens = Lens(camera.intrinsics, camera.width, camera.height, (-0.12, 0.02, 0.0), (0.001, -0.001))
    sighting = find_board(board, photo_of_table(board, camera, lens), lens)
    assert sighting is not None
    millimetres, degrees = apart(inverse(sighting.camera_from_board), camera.world_from_camera)
    assert millimetres < 1
    assert degrees < 0.1


@pytest.mark.slow
def test_april_tags_do_the_same(tmp_path: Path, cameras: list[Camera]):
    (tmp_path / "tags.json").write_text(json.dumps(TAGS))
    board = read_board(str(tmp_path / "tags.json"))
    camera = cameras[1]
    sighting = find_board(
        board, photo_of_table(board, camera), Lens(camera.intrinsics, camera.width, camera.height)
    )
    assert sighting is not None
    assert sighting.num_points == 12
    millimetres, degrees = apart(inverse(sighting.camera_from_board), camera.world_from_camera)
    assert millimetres < 4
    assert degrees < 0.5


def test_no_board_no_camera(board: Board):
    blank = np.full((480, 640, 3), 128, dtype=np.uint8)
    assert find_board(board, blank, Lens(np.diag([600.0, 600, 1]), 640, 480)) is None


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_lens_is_calibrated_from_photos(board: Board):
    eyes = [*EYES, (0.1, 0.5, 0.4), (-0.3, 0.1, 0.3), (0.5, 0.1, 0.3), (0.126, 0.05, 0.45)]
    cameras = [camera_at(np.array(eye), np.array([0.126, 0.09, 0.0])) for eye in eyes]
    true = Lens(cameras[0].intrinsics, 640, 480, (-0.1, 0.0, 0.0))
    lens = calibrate(board, [photo_of_table(board, camera, true) for camera in cameras])
    np.testing.assert_allclose(lens.intrinsics, true.intrinsics, atol=3)
    assert lens.radial[0] == pytest.approx(-0.1, abs=0.02)
    assert lens.radial[1:] == (0, 0)
    with pytest.raises(InputError, match="found in 0 of 3 photos"):
        calibrate(board, [np.zeros((480, 640, 3), dtype=np.uint8)] * 3)


def write_capture(folder: Path, images: Sequence[np.ndarray], backgrounds: Sequence[np.ndarray]) -> None:
    for kind, pictures in (("images", images), ("backgrounds", backgrounds)):
        (folder / kind).mkdir(parents=True)
        for i, picture in enumerate(pictures):
            Picture.fromarray(picture).save(folder / kind / f"{i}.png")


def write_camera(folder: Path, camera: Camera) -> None:
    data = {"intrinsics": camera.intrinsics.tolist(), "width": camera.width, "height": camera.height}
    (folder / "camera.json").write_text(json.dumps(data))


@pytest.mark.slow
def test_photos_with_a_board_become_a_scene(
    board: Board, cameras: list[Camera], photos: list[np.ndarray], tmp_path: Path
):
    """The cube stands behind the board, and every camera is where it was."""
    write_capture(tmp_path / "capture", photos, photos)
    write_camera(tmp_path / "capture", cameras[0])
    assert cli.main(["import", "board", str(tmp_path / "capture"), "--out", str(tmp_path / "scene")]) == 0
    scene = read_scene(tmp_path / "scene")
    np.testing.assert_allclose(scene.workspace.to_world(scene.workspace.centre), (0.126, 0.35, 0), atol=1e-9)
    for view, camera, photo in zip(scene.frames, cameras, photos, strict=True):
        assert np.array_equal(view.background, photo)
        millimetres, degrees = apart(view.camera.world_from_camera, camera.world_from_camera)
        assert millimetres < 1
        assert degrees < 0.1


@pytest.mark.slow
def test_a_background_from_beside_is_warped_along_the_table(
    board: Board, cameras: list[Camera], photos: list[np.ndarray], tmp_path: Path
):
    """A hand-held camera does not come back to its place; the table is flat, so that can be undone."""
    camera = cameras[0]
    aside = camera.moved(rigid(rotation_about((0, 0, 1), 0.02), (0.004, -0.01, 0.006)))
    write_capture(tmp_path / "capture", photos[:1], [photo_of_table(board, aside)])
    write_camera(tmp_path / "capture", camera)
    assert cli.main(["import", "board", str(tmp_path / "capture"), "--out", str(tmp_path / "scene")]) == 0
    (view,) = read_scene(tmp_path / "scene").frames
    assert view.camera.sensed is not None
    left, top, right, bottom = (round(edge + 0.5) for edge in view.camera.sensed)
    seen = np.s_[top:bottom, left:right]
    assert view.image[seen].size > 0.8 * view.image.size
    difference = np.abs(view.image[seen].astype(float) - view.background[seen]).mean()
    unwarped = np.abs(photos[0].astype(float) - photo_of_table(board, aside)).mean()
    assert difference < 2.5 < unwarped / 3


@pytest.mark.slow
def test_a_reconstruction_gets_its_scale_from_the_board(
    board: Board, cameras: list[Camera], photos: list[np.ndarray], tmp_path: Path
):
    views = views_of(photos, cameras, board)
    model = write_colmap(tmp_path / "capture", views, ARBITRARY, is_binary=True)
    arguments = ["import", "colmap", str(model), "--board", "default", "--out", str(tmp_path / "scene")]
    assert cli.main(arguments) == 0
    for view, camera in zip(read_scene(tmp_path / "scene").frames, cameras, strict=True):
        millimetres, degrees = apart(view.camera.world_from_camera, camera.world_from_camera)
        assert millimetres < 1
        assert degrees < 0.1


@pytest.mark.slow
def test_a_robot_keeps_its_base_and_finds_the_cube_by_the_board(
    board: Board, cameras: list[Camera], photos: list[np.ndarray], tmp_path: Path
):
    base_from_board = rigid(rotation_about((0, 0, 1), -2.0), (0.5, 0.1, 0.02))
    moved = [camera.moved(base_from_board) for camera in cameras]
    file = write_robot(tmp_path / "capture", replace(views_of(photos, moved, board)))
    arguments = ["import", "robot", str(file), "--board", "default", "--out", str(tmp_path / "scene")]
    assert cli.main(arguments) == 0
    scene = read_scene(tmp_path / "scene")
    expected = base_from_board @ board.workspace().world_from_workspace
    millimetres, degrees = apart(scene.workspace.world_from_workspace, expected)
    assert millimetres < 1
    assert degrees < 0.1
    for view, camera in zip(scene.frames, moved, strict=True):
        np.testing.assert_allclose(view.camera.world_from_camera, camera.world_from_camera, atol=1e-9)


@pytest.mark.slow
def test_a_photo_without_the_board_is_named(
    cameras: list[Camera], photos: list[np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    write_capture(tmp_path / "capture", photos[:2], [photos[0], np.full_like(photos[1], 90)])
    write_camera(tmp_path / "capture", cameras[0])
    assert cli.main(["import", "board", str(tmp_path / "capture"), "--out", str(tmp_path / "scene")]) == 2
    assert "backgrounds/1.png: the board is not found" in capsys.readouterr().err
    assert not (tmp_path / "scene").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "chess"}, "kind is 'chess'; it must be 'charuco' or 'tags'"),
        ({"kind": "charuco", "square": 36}, "metres!"),
        ({"kind": "charuco", "marker": "big"}, "marker: of another shape or type"),
        ({"kind": "tags", "tags": []}, "'tags' must be a list"),
        ({"kind": "tags", "tags": [{"id": 0, "size": 50}]}, r"tag 0: size 50 m; it must be 0\.005 to 0\.5"),
        ({"kind": "charuco", "board_from_workspace": [1, 2]}, "board_from_workspace: of another shape"),
    ],
)
def test_a_wrong_board_file_is_named(tmp_path: Path, change: dict, message: str):
    (tmp_path / "board.json").write_text(json.dumps(change))
    with pytest.raises(InputError, match=rf"board\.json.*{message}"):
        read_board(str(tmp_path / "board.json"))


def test_an_unknown_dictionary_is_named(tmp_path: Path):
    (tmp_path / "board.json").write_text(json.dumps({"kind": "charuco", "dictionary": "DICT_9X9"}))
    with pytest.raises(InputError, match="unknown dictionary 'DICT_9X9'"):
        sheet(read_board(str(tmp_path / "board.json")), "a4")
    with pytest.raises(InputError, match="tag 999: DICT_APRILTAG_36h11 has tags 0 to 586"):
        sheet(Board(Tags((Tag(999, 0.05, (0.025, 0.025)),))), "a4")
    blank, lens = np.zeros((48, 64, 3), np.uint8), Lens(np.diag([60.0, 60, 1]), 64, 48)
    with pytest.raises(InputError, match="tag 999: DICT_APRILTAG_36h11 has tags 0 to 586"):
        find_board(Board(Tags((Tag(999, 0.05, (0.025, 0.025)),))), blank, lens)


@pytest.mark.slow
@pytest.mark.parametrize("paper", ["a4", "letter", "a3"])
def test_the_page_is_the_paper_and_the_board_is_true_to_size(tmp_path: Path, board: Board, paper: str):
    """The board is found on the page itself, seen from straight above by a camera of 1 pixel per dot."""
    assert cli.main(["board", "--out", str(tmp_path / "board.png"), "--paper", paper]) == 0
    with Picture.open(tmp_path / "board.png") as picture:
        dots = picture.info["dpi"][0] / 0.0254
        page = np.asarray(picture.convert("RGB"))
    width, height = PAPERS[paper]  # type: ignore[index]
    assert abs(page.shape[1] / dots - width) < 1e-4
    assert abs(page.shape[0] / dots - height) < 1e-4
    small = page[::4, ::4]
    camera = np.array([[dots / 4, 0, small.shape[1] / 2], [0, dots / 4, small.shape[0] / 2], [0, 0, 1]])
    sighting = find_board(board, np.ascontiguousarray(small), Lens(camera, small.shape[1], small.shape[0]))
    assert sighting is not None
    assert sighting.camera_from_board[2, 3] == pytest.approx(1.0, abs=0.003)
    # Looking down, the board's y points up the page and its z at the camera.
    np.testing.assert_allclose(np.diag(sighting.camera_from_board)[:3], (1, -1, -1), atol=0.01)


def test_a_pdf_is_one_page_of_that_paper(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["board", "--out", str(tmp_path / "sub/board.pdf")]) == 0
    data = (tmp_path / "sub/board.pdf").read_bytes()
    box = data.split(b"/MediaBox [")[1].split(b"]")[0].split()
    points = [float(value) for value in box[2:]]
    np.testing.assert_allclose(points, [297 / 25.4 * 72, 210 / 25.4 * 72], atol=0.3)
    assert "print at 100 %" in capsys.readouterr().out
    assert cli.main(["board", "--out", str(tmp_path / "board.jpg")]) == 2
    assert "written as .pdf or .png" in capsys.readouterr().err
    assert [file.name for file in (tmp_path / "sub").iterdir()] == ["board.pdf"]
