"""What is drawn: shapes, colours and places that can be computed another way."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from ball_record import photo
from neugrasp.geometry.pose import apply, inverse
from neugrasp.geometry.surface import Surface
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.srgb import linear
from neugrasp.viewer.cameras import base
from neugrasp.viewer.drawing import colour_of, describe, grasps_of, nodes_of
from neugrasp.viewer.glb import glb
from neugrasp.viewer.hand_meshes import hand_mesh
from neugrasp.viewer.primitives import Node, PictureNode
from neugrasp.viewer.scene_data import GraspMarker, SceneData
from neugrasp.viewer.settings import HANDS, Settings
from neugrasp.viewer.table_texture import PIXELS, edge
from neugrasp.viewer.vertex_colours import (
    UNSEEN,
    Field,
    by_confidence,
    by_photos,
    by_views,
    fine_surface,
    ramp,
    things_on_table,
    visibility,
)
from neugrasp.viewer.viewpoint import landmarks, viewpoint

from .conftest import BALL, RADIUS, SCORES, ball_grasps


@pytest.fixture
def field(ball_tsdf: np.ndarray) -> Field:
    return Field(ball_tsdf, Workspace())


def named(nodes: tuple[Node, ...], name: str) -> Node:
    return next(node for node in nodes if node.name == name)


def volume(surface: Surface) -> float:
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


def test_the_drawn_surface_is_the_ball_within_a_quarter_of_a_voxel(ball_tsdf: np.ndarray):
    things = things_on_table(ball_tsdf, Workspace())
    free = things.vertices[things.vertices[:, 2] > 0.062]
    distance = np.linalg.norm(free - BALL, axis=-1) - RADIUS
    assert np.abs(distance).max() < Workspace().voxel_size / 4
    assert things.vertices[:, 2].min() >= 0.05
    whole = fine_surface(ball_tsdf, Workspace())
    assert np.ptp(whole.vertices[:, 0]) > 0.28  # The table is part of it.
    assert np.ptp(things.vertices[:, 0]) < 0.08


def test_cameras_see_the_top_of_the_ball_and_not_its_underside(data: SceneData, field: Field):
    offsets = np.array([(0, 0, RADIUS), (0, 0, -0.7 * RADIUS)])
    offsets[1, 0] = np.sqrt(RADIUS**2 - offsets[1, 2] ** 2)
    spots = Surface(BALL + offsets, np.zeros((0, 3), dtype=np.int32))
    seen = visibility(spots, field, data.views)
    assert seen.shape == (4, 2)
    assert (seen[:, 0] > 0).all()
    assert (seen[:, 1] == 0).all()
    assert np.array_equal(by_views(spots, field, data.views), ramp([1.0, 0.0]))


def test_the_shadowed_table_beside_the_ball_is_hidden_from_one_side(data: SceneData, field: Field):
    camera = data.views[0].camera
    away = (BALL - camera.centre) * (1, 1, 0)
    behind = BALL + 0.035 * away / np.linalg.norm(away)
    before = BALL - 0.07 * away / np.linalg.norm(away)
    spots = np.array([behind, before]) * (1, 1, 0) + (0, 0, 0.05)
    seen = visibility(Surface(spots, np.zeros((0, 3), dtype=np.int32)), field, data.views)[0]
    assert seen[0] == 0
    assert seen[1] > 0


def test_photos_paint_the_ball_red(data: SceneData, field: Field, ball_tsdf: np.ndarray):
    things = things_on_table(ball_tsdf, Workspace())
    seen = visibility(things, field, data.views).max(axis=0)
    top = things.vertices[:, 2] > BALL[2] + 0.3 * RADIUS
    colours = by_photos(things, field, data.views).astype(float)
    red, green, blue = colours[top & (seen > 0.05)].T
    assert len(red) > 100
    assert (red > 2.5 * green).all()
    assert (red > 2.5 * blue).all()
    assert np.allclose(colours[seen == 0], UNSEEN, atol=1)


def test_a_true_distance_is_a_confident_surface_and_a_smeared_one_is_not(field: Field, ball_tsdf: np.ndarray):
    things = things_on_table(ball_tsdf, Workspace())
    top = Surface(things.vertices[things.vertices[:, 2] > 0.1], np.zeros((0, 3), dtype=np.int32))
    sharp = by_confidence(top, field).astype(float)
    smeared = by_confidence(top, Field(field.grid / 5, field.workspace)).astype(float)
    assert np.abs(sharp - ramp([1.0])).mean() < 12
    assert np.abs(smeared - ramp([0.2])).mean() < 12


@pytest.mark.parametrize("name", ["panda", "robotiq_2f85"])
@pytest.mark.parametrize("opening", [0.0, 0.031, 0.08])
def test_pads_are_as_far_apart_as_the_grasp_is_wide(name: str, opening: float):
    gripper = Gripper.load(name)
    fingers = hand_mesh(gripper, opening, has_palm=False)
    y = fingers.vertices[:, 1]
    assert y[y > -1e-9].min() + -y[y < 1e-9].max() == pytest.approx(opening, abs=2.1e-3)
    assert fingers.vertices[:, 2].max() == pytest.approx(gripper.tip_height - gripper.tcp_height)
    assert volume(fingers) > 0  # Faces look outwards.
    mirrored = fingers.vertices * [-1, -1, 1]
    apart = np.linalg.norm(mirrored[:, None] - fingers.vertices, axis=-1).min(axis=1)
    assert apart.max() < 1e-9
    assert volume(hand_mesh(gripper, opening)) > volume(fingers)


def test_threshold_and_number_choose_the_best_grasps(data: SceneData):
    settings = Settings().suited_to(data)

    def drawn(**changes: object) -> list[float]:
        nodes = grasps_of(data, replace(settings, **changes))  # type: ignore[arg-type]
        return [node.marker.grasp.score for node in nodes if node.marker]

    assert drawn() == pytest.approx(SCORES)
    assert drawn(threshold=0.7) == pytest.approx(SCORES[:2])
    assert drawn(threshold=0.8) == pytest.approx(SCORES[:2])
    assert drawn(most=1) == pytest.approx(SCORES[:1])
    assert drawn(most=0) == []
    for hand in HANDS:
        assert len(drawn(hand=hand)) == 3


def test_a_hand_is_drawn_where_its_grasp_is(data: SceneData):
    node = grasps_of(data, replace(Settings().suited_to(data), hand="whole hand"))[1]
    expected = hand_mesh(data.gripper, 2 * RADIUS).moved(ball_grasps()[1].pose)
    assert np.allclose(node.surface.vertices, expected.vertices, atol=1e-6)


def test_colours_go_from_red_to_green_with_the_score_and_tell_success():
    grasp = ball_grasps()[0]
    worst, middle, best = (colour_of(GraspMarker(replace(grasp, score=s))) for s in (0.5, 0.75, 1.0))
    assert worst[0] > 2 * worst[1]
    assert min(middle[:2]) > 2 * middle[2]
    assert best[1] > 2 * best[0]
    assert colour_of(GraspMarker(grasp, True)) == best
    assert colour_of(GraspMarker(grasp, False)) == worst


def test_a_click_says_score_width_and_place_in_the_users_world(data: SceneData):
    words = describe(data, data.moments[0].grasps[0])
    place = " ".join(f"{x:+.3f}" for x in data.workspace.to_world(BALL))
    assert "0.950" in words
    assert "60 mm" in words
    assert place in words


def test_what_did_not_change_is_not_sent_again(data: SceneData):
    settings = Settings().suited_to(data)
    before = {node.name: node for node in nodes_of(data, settings)}
    assert len(before) == len(nodes_of(data, settings))
    chosen = replace(settings, threshold=0.7, selected=data.moments[0].grasps[0])
    after = {node.name: node for node in nodes_of(data, chosen)}
    changed = {name for name in before if after.get(name) is not before[name]}
    assert changed == {"grasps/000", "grasps/002", "numbers/3"}
    assert set(after) - set(before) == {"selected"}


def test_everything_can_be_hidden(data: SceneData):
    settings = Settings().suited_to(data)
    hidden = {name: False for name in vars(settings) if name.startswith("shows_")}
    assert nodes_of(data, replace(settings, most=0, **hidden)) == ()  # type: ignore[arg-type]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_slice_lies_where_its_voxels_are(data: SceneData, axis: int):
    workspace = data.workspace
    spots = {"ball": BALL, "air": BALL + 0.06, "table": np.array([0.25, 0.05, 0.02])}
    for name, spot in spots.items():
        index = int(workspace.index_of(spot)[axis])
        settings = replace(Settings().suited_to(data), slice_axis="xyz"[axis], slice_index=index)
        node = named(nodes_of(data, settings), "slice")
        assert isinstance(node, PictureNode)
        assert np.allclose(np.linalg.det(node.pose[:3, :3]), 1)
        x, y, z = apply(inverse(node.pose), spot)
        assert abs(z) <= workspace.voxel_size / 2 + 1e-9
        pixels = node.pixels.shape[0]
        column, row = (int((value / workspace.size + 0.5) * pixels) for value in (x, y))
        red, _, blue = node.pixels[row, column, :3].astype(int)
        assert (red > blue) == (name != "air")


def test_a_photo_lies_on_the_lines_of_sight_of_its_pixels(data: SceneData):
    nodes = nodes_of(data, Settings().suited_to(data))
    padded = 0
    for i, view in enumerate(data.views):
        node = named(nodes, f"cameras/{i}/photo")
        assert isinstance(node, PictureNode)
        height, width = node.pixels.shape[:2]
        _, top, _, bottom = view.camera.bounds
        rows = np.arange(view.camera.height)
        assert height == np.count_nonzero((rows > top) & (rows < bottom))  # Padding is left out.
        padded += height < view.camera.height
        column, row = 10, 70
        x, y = (column + 0.5) / width - 0.5, (row + 0.5) / height - 0.5
        spot = apply(node.pose, (x * node.width, y * node.height, 0.0))
        pixel, depth = view.camera.project(spot)
        assert depth > 0
        u, v = pixel.round().astype(int)
        assert np.allclose(pixel, (u, v), atol=1e-6)
        assert np.array_equal(view.image[v, u], node.pixels[row, column])
        assert np.allclose(np.linalg.norm(base(view.camera)[1] - base(view.camera)[0]), node.width)
    assert padded > 0


def test_the_tabletop_shows_the_squares_of_the_table_where_they_are(data: SceneData):
    node = named(nodes_of(data, Settings().suited_to(data)), "table")
    assert isinstance(node, PictureNode)
    correct = 0
    spots = [(0.045 + 0.03 * i, 0.045 + 0.03 * j) for i in range(7) for j in range(7)]
    for x, y in spots:
        place = apply(inverse(node.pose), (x, y, data.workspace.table_height))
        column, row = (int((value / edge(data.workspace) + 0.5) * PIXELS) for value in place[:2])
        is_light = (int(x / 0.03) + int(y / 0.03)) % 2 == 1
        red, _, blue = node.pixels[row, column, :3].astype(int)
        correct += (red > blue) == is_light
    assert correct == len(spots)
    assert node.pixels[PIXELS // 2, PIXELS // 2, 3] == 255


def test_the_first_look_holds_everything(data: SceneData):
    eye = viewpoint(data)
    seen = apply(inverse(eye.pose()), landmarks(data))
    slopes = np.abs(seen[:, :2] / seen[:, 2:]) / np.tan(eye.field_of_view / 2)
    assert (seen[:, 2] > 0).all()
    assert (slopes <= (1.6, 1.0)).all()
    assert (slopes.max(axis=0) / (1.6, 1.0)).max() > 0.85


def test_a_glb_file_holds_the_mesh_again():
    surface = Surface(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5], [2, 2, 2]], float), np.array([[0, 1, 2]]))
    colours = np.array([[255, 0, 0], [0, 128, 0], [0, 0, 255], [1, 2, 3]], dtype=np.uint8)
    data = glb(surface, colours)
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size = struct.unpack_from("<I", data, 12)[0]
    head, body = json.loads(data[20 : 20 + size]), data[28 + size :]
    assert head["buffers"][0]["byteLength"] == len(body)

    def array(number: int, kind: str) -> np.ndarray:
        view = head["bufferViews"][number]
        part = body[view["byteOffset"] :][: view["byteLength"]]
        return np.frombuffer(part, kind)

    assert np.allclose(array(0, "<f4").reshape(-1, 3), surface.vertices)
    normals = array(1, "<f4").reshape(-1, 3)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    assert np.allclose(array(2, "<f4").reshape(-1, 3), linear(colours / 255), atol=1e-6)
    assert array(3, "<u4").tolist() == [0, 1, 2]
    assert linear(np.array([255], np.uint8) / 255)[0] == pytest.approx(1)
    assert linear(np.array([188], np.uint8) / 255)[0] == pytest.approx(0.5, abs=0.01)


def test_the_ball_of_these_tests_is_red_in_its_photos(data: SceneData):
    image, _ = photo(data.views[0].camera, (BALL, RADIUS))
    assert np.array_equal(image, data.views[0].image)
