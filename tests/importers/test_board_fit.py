"""A board is believed only where it fits what was described; else the reason is told."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture
from scipy import ndimage

from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.lens import Lens
from neugrasp.geometry.pose import inverse, rigid
from neugrasp.importers.board import FIRST_TAGS, Board, Charuco, Tag, Tags
from neugrasp.importers.board_file import read_board

pytest.importorskip("cv2")

import cv2

from neugrasp.importers import markers
from neugrasp.importers.markers import find_board, other_markers, picture_of
from neugrasp.importers.photos import Pair
from neugrasp.importers.planar_fit import fit, mapped
from neugrasp.importers.upright import settled
from table_photos import camera_at, photo_of_table

TARGET = np.array([0.126, 0.10, 0.0])
CAMERA = camera_at(np.array([-0.1, -0.35, 0.50]), TARGET)
LENS = Lens(CAMERA.intrinsics, CAMERA.width, CAMERA.height)
TAGS = Tags(
    (
        Tag(3, 0.06, (0.03, 0.03)),
        Tag(11, 0.06, (0.22, 0.05), np.deg2rad(30)),
        Tag(20, 0.08, (0.12, 0.13), -np.pi / 2),
    ),
    upright="official",
)
SMALL = Charuco(7, 6, 0.03, 0.022)


def apart(pose: np.ndarray, camera: Camera) -> tuple[float, float]:
    """Millimetres and degrees between a pose and a camera's."""
    turn = np.trace(pose[:3, :3].T @ camera.world_from_camera[:3, :3])
    return (
        1000 * float(np.linalg.norm(pose[:3, 3] - camera.world_from_camera[:3, 3])),
        float(np.rad2deg(np.arccos(np.clip((turn - 1) / 2, -1, 1)))),
    )


def changed(place: int, **change: object) -> Tags:
    """The three tags, one of them described otherwise."""
    tags = list(TAGS.tags)
    tags[place] = replace(tags[place], **change)  # type: ignore[arg-type]
    return replace(TAGS, tags=tuple(tags))


def refusal(printed: Charuco | Tags, described: Charuco | Tags) -> str:
    """What is said of a photo of one board that is described as another."""
    photo = photo_of_table(Board(printed), CAMERA)
    with pytest.raises(InputError) as caught:
        find_board(Board(described), photo, LENS)
    return str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("described", "reason"),
    [
        (changed(0, centre=(0.033, 0.03)), r"tag 3 lies \d mm away from its 'centre'"),
        (changed(0, centre=(0.06, 0.03)), "tag 3 lies 3[01] mm away from its 'centre'"),
        (changed(1, turn=np.deg2rad(35)), r"tag 11 lies \d mm away .* turned by -[56] degrees"),
        (changed(1, turn=np.deg2rad(120)), r"tag 11 .* turned by -9[01] degrees"),
        (changed(2, size=0.07), r"tag 20 lies 0 mm away .* (79|80) mm large"),
        (
            replace(TAGS, tags=tuple(replace(tag, size=0.8 * tag.size) for tag in TAGS.tags)),
            r"measure 'size' .*; 60, 60, (79|80) mm would fit",
        ),
        (
            replace(TAGS, tags=tuple(replace(t, number={3: 11, 11: 3}.get(t.number, 20)) for t in TAGS.tags)),
            "the numbers (11 and 3|3 and 11) are exchanged",
        ),
        (replace(TAGS, upright="opencv"), 'turned by 180 degrees; write "upright": "official"'),
    ],
    ids=["3 mm", "30 mm", "5 degrees", "90 degrees", "one size", "all sizes", "numbers", "other print"],
)
def test_tags_that_lie_otherwise_are_refused_with_the_reason(described: Tags, reason: str):
    text = refusal(TAGS, described)
    assert "the board does not fit: its corners are" in text

    assert re.search(reason, text), text


@pytest.mark.slow
def test_two_tags_cannot_tell_which_of_them_moved():
    two = replace(TAGS, tags=TAGS.tags[:2])
    moved = replace(two, tags=(replace(two.tags[0], turn=np.pi / 2), two.tags[1]))
    assert "measure 'centre', 'size' and 'turn_deg' of the tags 3, 11" in refusal(two, moved)


@pytest.mark.slow
@pytest.mark.parametrize("centre", [(0.22, 0.05), (0.03, 0.13)], ids=["beside", "behind"])
def test_a_number_that_is_seen_twice_is_refused(centre: tuple[float, float]):
    """Of two prints of one tag nobody knows which one is meant."""
    single = Tags(TAGS.tags[:1], upright="official")
    twice = replace(single, tags=(*single.tags, replace(single.tags[0], centre=centre)))
    for described in (single, TAGS):
        assert "tag 3 is seen more than once; take the other prints" in refusal(twice, described)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("printed", "described", "reason"),
    [
        (replace(SMALL, legacy=True), SMALL, 'legacy pattern .*: write "legacy": true'),
        (SMALL, replace(SMALL, legacy=True), 'not the legacy pattern: leave "legacy" away'),
        (Charuco(6, 6, 0.03, 0.022, legacy=True), Charuco(6, 6, 0.03, 0.022), "legacy pattern"),
        (Charuco(), Charuco(5, 7), "rows and columns are exchanged: they fit 7 columns and 5 rows"),
        (Charuco(), Charuco(8, 5), "they fit 7 columns and 5 rows"),
        (SMALL, Charuco(7, 5, 0.03, 0.022), "they fit 7 columns and 6 rows"),
        (Charuco(), Charuco(7, 6), "has the print 5 rows, not 6"),
    ],
    ids=[
        "legacy",
        "not legacy",
        "legacy, even columns",
        "exchanged",
        "a column more",
        "a row less",
        "a row more",
    ],
)
def test_another_chessboard_is_recognised(printed: Charuco, described: Charuco, reason: str):

    text = refusal(printed, described)
    assert re.search(reason, text), text


@pytest.mark.slow
@pytest.mark.parametrize("printed", [replace(SMALL, legacy=True), Charuco(6, 6, 0.03, 0.022, legacy=True)])
def test_the_legacy_pattern_is_found_where_it_is_described(printed: Charuco):
    sighting = find_board(Board(printed), photo_of_table(Board(printed), CAMERA), LENS)
    assert sighting is not None
    millimetres, degrees = apart(inverse(sighting.camera_from_board), CAMERA)
    assert millimetres < 1.5
    assert degrees < 0.15


@pytest.mark.parametrize("columns", [3, 6, 7])
@pytest.mark.parametrize("rows", [3, 4, 5, 6])
@pytest.mark.parametrize("legacy", [False, True])
def test_markers_are_where_opencv_draws_them(columns: int, rows: int, legacy: bool):
    board = Charuco(columns, rows, 0.03, 0.02, legacy=legacy)
    theirs = np.stack(markers._charuco(cv2, board).getObjPoints())
    theirs[..., 1] = board.size[1] - theirs[..., 1]
    np.testing.assert_allclose(board.markers(), theirs, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("printed", "described", "words"),
    [
        (Charuco(dictionary="DICT_5X5_100"), Charuco(), "markers of DICT_5X5_50 are seen"),
        (Charuco(dictionary="DICT_6X6_250"), Charuco(), "markers of DICT_6X6_50 are seen"),
        (replace(TAGS, dictionary="DICT_APRILTAG_25h9"), TAGS, r"markers of DICT_APRILTAG_25[hH]9 are seen"),
        (
            replace(TAGS, tags=tuple(replace(tag, number=tag.number + 1) for tag in TAGS.tags)),
            TAGS,
            "the tags 4, 12, 21 of DICT_APRILTAG_36h11 are seen, the board has 3, 11, 20",
        ),
    ],
    ids=["5 x 5", "6 x 6", "another family", "other numbers"],
)
def test_markers_of_another_kind_are_named(printed: Charuco | Tags, described: Charuco | Tags, words: str):

    photo = photo_of_table(Board(printed), CAMERA)
    assert find_board(Board(described), photo, LENS) is None
    text = other_markers(Board(described), photo)
    assert text is not None
    assert re.search(words, text), text


def test_a_table_without_a_board_has_no_other_markers():
    blank = np.full((480, 640, 3), 128, dtype=np.uint8)
    assert other_markers(Board(), blank) is None
    assert other_markers(Board(TAGS), blank) is None


@pytest.mark.slow
@pytest.mark.parametrize(("distance", "size"), [(0.9, 0.05), (0.6, 0.03)])
def test_a_tag_too_small_to_tell_the_direction_is_refused(distance: float, size: float):
    """Two poses explain it alike, or one that may as well be another."""
    tag = Board(Tags((Tag(0, size, (size / 2, size / 2)),), upright="official"))
    camera = camera_at(np.array([0.12, 0.0, distance]), np.array([0.126, 0.12, 0.0]))
    photo = photo_of_table(tag, camera)
    with pytest.raises(InputError, match="do not tell the camera's direction within 2 degrees"):
        find_board(tag, photo, Lens(camera.intrinsics, camera.width, camera.height))


@pytest.mark.slow
@pytest.mark.parametrize("blur", [1.5, 2.0])
def test_a_blurred_tag_gives_the_camera_or_none(rng: np.random.Generator, blur: float):
    """Never the one that is mirrored about the line of sight, half a metre away."""
    tag = Board(Tags((Tag(0, 0.06, (0.03, 0.03)),), upright="official"))
    camera = camera_at(np.array([0.10, -0.30, 0.62]), np.array([0.126, 0.12, 0.0]))
    photo = ndimage.gaussian_filter(photo_of_table(tag, camera).astype(float), (blur, blur, 0))
    lens = Lens(camera.intrinsics, camera.width, camera.height)
    for _ in range(12):
        noisy = (photo + rng.normal(0, 4 * blur, photo.shape)).round().clip(0, 255).astype(np.uint8)
        try:
            sighting = find_board(tag, noisy, lens)
        except InputError:
            continue
        assert sighting is None or apart(inverse(sighting.camera_from_board), camera)[1] < 8


@pytest.mark.slow
@pytest.mark.parametrize("dictionary", FIRST_TAGS)
@pytest.mark.parametrize("turn", [0, 1, 3])
def test_a_tag_of_the_official_pictures_gives_the_right_world(dictionary: str, turn: int):
    """Drawn from the family's own code, whatever the library thinks is upright."""
    board = Board(Tags((Tag(0, 0.08, (0.06, 0.06), turn * np.pi / 2),), dictionary, "official"))
    bits = board.print.first_picture  # type: ignore[union-attr]
    picture = np.kron(np.rot90(np.pad(bits, 1), turn), np.ones((40, 40)))
    photo = paper(picture, (0.02, 0.02, 0.08))
    sighting = find_board(board, photo, LENS)
    assert sighting is not None
    millimetres, degrees = apart(inverse(sighting.camera_from_board), CAMERA)
    assert millimetres < 12
    assert degrees < 1.5


def paper(picture: np.ndarray, place: tuple[float, float, float]) -> np.ndarray:
    """A photo of a square picture (0 to 1) on white paper: its lower left corner and its edge, metres."""
    u, v = np.meshgrid(np.arange(0, 640, 0.5) - 0.25, np.arange(0, 480, 0.5) - 0.25)
    towards = CAMERA.unproject(np.stack([u, v], axis=-1), np.ones(u.shape)) - CAMERA.centre
    points = CAMERA.centre + towards * (-CAMERA.centre[2] / towards[..., 2:])
    left, bottom, edge = place
    rows = (bottom + edge - points[..., 1]) / edge * len(picture)
    columns = (points[..., 0] - left) / edge * len(picture)
    inside = (rows >= 0) & (rows < len(picture)) & (columns >= 0) & (columns < len(picture))
    last = len(picture) - 1
    seen = picture[rows.astype(int).clip(0, last), columns.astype(int).clip(0, last)]
    grey = np.where(inside, 20 + 215 * seen, 235.0).reshape(480, 2, 640, 2).mean(axis=(1, 3))
    return np.repeat(grey.round().astype(np.uint8)[..., None], 3, axis=-1)


@pytest.mark.parametrize("dictionary", FIRST_TAGS)
def test_the_sheet_shows_the_official_picture(dictionary: str):
    tags = Tags((Tag(0, 0.08, (0.04, 0.04)),), dictionary, "official")
    bits = tags.first_picture
    assert bits is not None
    side = len(bits) + 2
    picture = picture_of(Board(tags), 1000 * side)[..., 0]
    cells = picture.reshape(side, picture.shape[0] // side, side, -1).mean(axis=(1, 3)) > 127
    np.testing.assert_array_equal(cells[1:-1, 1:-1], bits > 0)
    turned = picture_of(Board(replace(tags, upright="opencv")), 1000 * side)[..., 0]
    np.testing.assert_array_equal(turned > 127, picture[::-1, ::-1] > 127)


def pair_of(folder: Path, background: np.ndarray, image: np.ndarray) -> dict[str, Pair]:
    for name, photo in (("background", background), ("image", image)):
        Picture.fromarray(photo).save(folder / f"{name}.png")
    return {"0": Pair(folder / "image.png", folder / "background.png")}


@pytest.mark.slow
@pytest.mark.parametrize("upright", ["official", "opencv"])
def test_two_tags_tell_whose_pictures_they_are(tmp_path: Path, upright: str):
    photo = photo_of_table(Board(replace(TAGS, upright=upright)), CAMERA)  # type: ignore[arg-type]
    board = settled(Board(replace(TAGS, upright=None)), pair_of(tmp_path, photo, photo))
    assert board.print.upright == upright  # type: ignore[union-attr]


def with_object(photo: np.ndarray, camera: Camera, place: tuple[float, float]) -> np.ndarray:
    """A red box, 6 cm wide, stands at a place of the table: its corners' outline, filled."""
    offsets = np.array([(x, y, z) for x in (-0.03, 0.03) for y in (-0.03, 0.03) for z in (0, 0.05)])
    pixels, _ = camera.project(np.array([*place, 0.0]) + offsets)
    outline = cv2.convexHull(pixels.round().astype(np.int32))
    return np.asarray(cv2.fillConvexPoly(photo.copy(), outline, (200, 40, 40)))


LONE = Tags((Tag(0, 0.06, (0.03, 0.03)),))
ABOVE = camera_at(np.array([0.02, -0.45, 0.75]), np.array([0.03, 0.08, 0.0]), focal=480.0)
SPOTS = [(0.03, 0.23), (-0.06, 0.15), (0.13, 0.30)]
"""Of the cube behind the tag, in the frame of the upright tag."""


@pytest.mark.slow
@pytest.mark.parametrize("spot", SPOTS)
@pytest.mark.parametrize("upright", ["official", "opencv"])
def test_objects_tell_whose_picture_a_lone_tag_is(tmp_path: Path, upright: str, spot: tuple[float, float]):
    """The print is laid upright by whoever prints it; the cube stands behind it, and the objects in the "
    "cube."""
    photo = photo_of_table(Board(replace(LONE, upright=upright)), ABOVE)  # type: ignore[arg-type]
    board = settled(Board(LONE), pair_of(tmp_path, photo, with_object(photo, ABOVE, spot)))
    assert board.print.upright == upright  # type: ignore[union-attr]


@pytest.mark.slow
def test_a_lone_tag_that_nothing_tells_about_is_refused(tmp_path: Path):
    """Nothing stands in the cube, or the cube stands about the tag, or as much has changed on both sides."""
    photo = photo_of_table(Board(replace(LONE, upright="official")), ABOVE)
    both = with_object(with_object(photo, ABOVE, SPOTS[0]), ABOVE, (0.03, -0.17))
    about = Board(LONE, rigid(translation=(-0.12, -0.12, -0.05)))
    for board, image in (
        (Board(LONE), photo),
        (Board(LONE), both),
        (about, with_object(photo, ABOVE, SPOTS[0])),
    ):
        with pytest.raises(
            InputError, match=r'tag 0 alone does not tell .* "upright": "official" .* "opencv"'
        ):
            settled(board, pair_of(tmp_path, photo, image))
    said = Board(replace(LONE, upright="opencv"))
    assert settled(said, pair_of(tmp_path, photo, photo)) is said
    other = Board(replace(LONE, dictionary="DICT_4X4_50"))
    assert settled(other, pair_of(tmp_path, photo, photo)) is other


def test_a_homography_is_found_exactly(rng: np.random.Generator):
    matrix = np.array([[500.0, 30, 320], [20, -480, 240], [0.3, 0.2, 1]])
    points = rng.uniform(-0.2, 0.2, size=(12, 2))
    found = fit(points, mapped(matrix, points))
    assert found.error < 1e-8
    np.testing.assert_allclose(found.matrix / found.matrix[2, 2], matrix, rtol=1e-6, atol=1e-6)


TAG = {"id": 0, "size": 0.05}


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"kind": "charuco", "columns": 6.5}, r"columns: 6\.5; it must be a whole number"),
        ({"kind": "charuco", "columns": 1e6}, "3 to 100 columns"),
        ({"kind": "charuco", "legacy": "yes"}, "legacy is 'yes'; it must be true or false"),
        ({"kind": "charuco", "square_mm": 36}, "'square_mm' is not known"),
        ({"kind": "charuco", "units": "mm"}, "'units' is not known"),
        ({"kind": "tags", "upright": "aruco", "tags": [TAG]}, "upright is 'aruco'; it must be 'official' or"),
        ({"kind": "tags", "tags": [{**TAG, "turn": 90}]}, "tag 0: 'turn' is not read; .* 'turn_deg'"),
        ({"kind": "tags", "tags": [{**TAG, "yaw": 1.5}]}, "tag 0: 'yaw' is not read"),
        ({"kind": "tags", "tags": [{**TAG, "centre": [0, 0], "center": [1, 0]}]}, "say the same; keep one"),
        ({"kind": "tags", "tags": [TAG, {**TAG, "centre": [0.2, 0]}]}, "two tags have the number 0"),
        ({"kind": "tags", "tags": [TAG, {**TAG, "id": 1}]}, "the tags 0 and 1 lie on each other"),
        ({"kind": "tags", "tags": [{**TAG, "id": -1}]}, "id: -1; it must be a whole number"),
    ],
)
def test_a_board_file_that_is_not_understood_is_refused(tmp_path: Path, data: dict, message: str):
    (tmp_path / "board.json").write_text(json.dumps(data))
    with pytest.raises(InputError, match=rf"board\.json.*{message}"):
        read_board(str(tmp_path / "board.json"))


def test_the_american_centre_is_the_same(tmp_path: Path):
    (tmp_path / "board.json").write_text(
        json.dumps({"kind": "tags", "tags": [{**TAG, "center": [0.2, 0.1]}]})
    )
    tags = read_board(str(tmp_path / "board.json")).print
    assert isinstance(tags, Tags)
    assert tags.tags[0].centre == (0.2, 0.1)
