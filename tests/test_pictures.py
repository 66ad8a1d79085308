"""Pictures show things where they are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import apply, from_quaternion, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.observation import View, Views
from neugrasp.pictures import (
    Tile,
    colour_of_score,
    contact_sheet,
    draw_grasps,
    free_where_unseen,
    overlay_sheet,
    photo_of_workspace,
    score_legend,
    shade_surface,
    slice_picture,
    surface_sheet,
)
from neugrasp.pictures.slices import busiest_slice

GRIPPER = Gripper.load("panda")
DOWN = np.diag([1.0, -1.0, -1.0])
CENTRE, RADIUS = (0.12, 0.17, 0.09), 0.035


def grey(camera: Camera, value: int = 128) -> View:
    image = np.full((camera.height, camera.width, 3), value, dtype=np.uint8)
    return View(camera, image, image)


@pytest.fixture
def view(cameras: list[Camera], workspace: Workspace) -> View:
    """A grey photo of the workspace, 256 x 256."""
    return grey(cameras[1].cropped_and_resized(workspace.photo_box(cameras[1]), 256, 256))


def test_a_grasp_is_drawn_along_its_wireframe_and_nowhere_else(view: View):
    grasp = Grasp(rigid(DOWN, (0.15, 0.15, 0.08)), width=0.06)
    picture = draw_grasps(view, [grasp], GRIPPER)
    assert picture.shape == (512, 512, 3)
    is_drawn = np.abs(picture.astype(int) - draw_grasps(view, [], GRIPPER)).max(axis=-1) > 20
    rows, columns = np.nonzero(is_drawn)
    drawn = np.stack([columns, rows], axis=-1)
    # In the enlarged picture a pixel of the photo is two pixels wide.
    segments = apply(grasp.pose, GRIPPER.wireframe(grasp.width))
    along = np.linspace(0, 1, 40)[:, None]
    points = np.concatenate([start + along * (end - start) for start, end in segments])
    wanted = (view.camera.project(points)[0] + 0.5) * 2 - 0.5
    nearest = np.linalg.norm(drawn[None] - wanted[:, None], axis=-1)
    assert nearest.min(axis=1).max() < 2, "every part of the wireframe is drawn"
    assert nearest.min(axis=0).max() < 12, "nothing is drawn elsewhere"


def pixels_of(picture: np.ndarray, score: float) -> int:
    """How many have the colour of a score."""
    return int((np.abs(picture.astype(int) - colour_of_score(score)).max(axis=-1) <= 6).sum())


@pytest.mark.parametrize("score", [1.0, 0.9, 0.75, 0.5, 0.2])
def test_a_colour_is_that_of_the_score_whatever_the_other_grasps_are(view: View, score: float):
    """Of one grasp, and of one among better and worse ones out of the picture."""
    here, away = rigid(DOWN, (0.15, 0.15, 0.08)), rigid(DOWN, (9.0, 9.0, 0.08))
    grasp = Grasp(here, 0.06, score)
    others = [Grasp(away, 0.06, 1.0), grasp, Grasp(away, 0.06, 0.1)]
    assert pixels_of(draw_grasps(view, [], GRIPPER), score) == 0
    assert pixels_of(draw_grasps(view, [grasp], GRIPPER), score) > 500
    assert pixels_of(draw_grasps(view, others, GRIPPER), score) > 500


def test_the_scale_of_scores_is_the_one_of_the_legend():
    legend = score_legend(320).astype(int)
    assert legend.shape == (44, 320, 3)
    scores = np.linspace(0.5, 1, 320 - 22 - 60 + 1)
    for x, score in zip(range(60, 320 - 22 + 1), scores, strict=True):
        assert tuple(legend[12, x]) == colour_of_score(float(score))
    assert colour_of_score(0.1) == colour_of_score(0.5) != colour_of_score(0.55)
    assert colour_of_score(1.001) == colour_of_score(1.0)


def test_several_grasps_are_numbered_and_the_best_lies_on_top(view: View):
    """The number stands at the arm's end; at the border where that is out of the picture."""
    place = rigid(DOWN, (0.15, 0.15, 0.08))
    grasps = [Grasp(place, 0.06, 0.99), Grasp(place, 0.06, 0.5)]
    several, best = draw_grasps(view, grasps, GRIPPER), draw_grasps(view, grasps[:1], GRIPPER)
    end = apply(place, GRIPPER.wireframe(0.06)[-1, 0])
    u, v = ((view.camera.project(end)[0] + 0.5) * 2 - 0.5).round().astype(int)
    around = (slice(v - 12, v + 13), slice(u - 12, u + 13))
    assert (several[around] != best[around]).any()
    assert several[around].min() < 60
    assert pixels_of(several, 0.99) > 5 * pixels_of(several, 0.5)

    palm, far = view.camera.project(apply(place, GRIPPER.wireframe(0.06)[-1, ::-1]))[0]
    assert far[1] < palm[1]
    top = (palm[1] + far[1]) / 2
    box = (palm[0] - 70, top, palm[0] + 70, top + 140)
    close = View(view.camera.cropped_and_resized(box, 256, 256), view.image, view.image)
    u, v = (close.camera.project(end)[0] + 0.5) * 2 - 0.5
    assert v < 0
    changed = draw_grasps(close, grasps, GRIPPER) != draw_grasps(close, grasps[:1], GRIPPER)
    rows, _ = np.nonzero(changed.any(axis=-1))
    assert rows.min() < 5


def test_a_grasp_behind_or_across_the_camera_breaks_nothing(view: View):
    behind = view.camera.unproject((128.0, 128.0), np.array(-0.2))
    across = view.camera.unproject((128.0, 128.0), np.array(0.02))
    for place in (behind, across):
        for quaternion in ([1, 0, 0, 0], [0, 0, 0, 1], [0.5, 0.5, 0.5, 0.5]):
            draw_grasps(view, [Grasp(from_quaternion(quaternion, place), 0.08)], GRIPPER)


def test_no_grasps_leave_the_photo_as_it_is(view: View):
    np.testing.assert_array_equal(draw_grasps(view, [], GRIPPER, smallest=256), view.image)


def test_large_photos_keep_their_size(cameras: list[Camera]):
    large = cameras[0].cropped_and_resized((-0.5, -0.5, 639.5, 359.5), 1280, 720)
    assert draw_grasps(grey(large), [], GRIPPER).shape == (720, 1280, 3)


def test_the_cut_photo_shows_what_its_camera_says(cameras: list[Camera], workspace: Workspace):
    """A bright spot at a known place is found where the cut camera projects it."""
    camera = cameras[2]
    point = np.array([0.1, 0.2, 0.05])
    photo = np.zeros((360, 640, 3), dtype=np.uint8)
    u, v = camera.project(point)[0].round().astype(int)
    photo[v - 2 : v + 3, u - 2 : u + 3] = 255
    cut = photo_of_workspace(View(camera, photo, photo), workspace, size=400)
    rows, columns = np.nonzero(cut.image[..., 0] > 128)
    expected = cut.camera.project(camera.unproject((u, v), camera.project(point)[1]))[0]
    np.testing.assert_allclose([columns.mean(), rows.mean()], expected, atol=0.6)


def test_padding_is_cut_away(cameras: list[Camera], workspace: Workspace):
    """The square crop of a wide photo reaches past it; people are shown what was measured."""
    camera = cameras[1].cropped_and_resized(workspace.photo_box(cameras[1]), 256, 256)
    left, top, right, bottom = camera.bounds
    shown = photo_of_workspace(grey(camera), workspace)
    assert max(shown.camera.width, shown.camera.height) == 512
    assert shown.camera.height / shown.camera.width == pytest.approx(
        (bottom - top) / (right - left), abs=0.01
    )
    assert (shown.image == 128).all()


def test_a_shaded_ball_has_the_outline_of_the_ball(
    view: View, workspace: Workspace, ball_on_table: Callable[..., np.ndarray]
):
    picture = shade_surface(ball_on_table(CENTRE, RADIUS, with_table=False), workspace, view.camera, size=256)
    is_ball = np.any(picture != 245, axis=-1)
    rays = view.camera.unproject(view.camera.pixel_grid(), np.ones((256, 256))) - view.camera.centre
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    offset = np.asarray(CENTRE) - view.camera.centre
    miss = np.linalg.norm(offset - (rays @ offset)[..., None] * rays, axis=-1)
    # Half a millimetre of leeway for the grid, less than half a pixel.
    np.testing.assert_array_equal(is_ball[miss < RADIUS - 1e-3], True)
    np.testing.assert_array_equal(is_ball[miss > RADIUS + 1e-3], False)


def test_objects_and_table_have_colours_of_their_own(
    view: View, workspace: Workspace, ball_on_table: Callable[..., np.ndarray]
):
    picture = shade_surface(ball_on_table(CENTRE, RADIUS), workspace, view.camera, size=256).astype(int)

    def colour_at(point: tuple[float, float, float]) -> np.ndarray:
        u, v = view.camera.project(point)[0].round().astype(int)
        return picture[v, u]

    ball, table = colour_at((CENTRE[0], CENTRE[1], CENTRE[2] + RADIUS)), colour_at((0.22, 0.08, 0.05))
    assert ball[2] > ball[0], "objects are blue"
    assert table[0] > table[2], "the table is brown"


def test_a_moved_world_gives_the_same_picture(
    view: View, workspace: Workspace, ball_on_table: Callable[..., np.ndarray]
):
    grid = ball_on_table(CENTRE, RADIUS)
    place = from_quaternion([0.1, 0.2, 0.3, 0.9], (3, -2, 1))
    there = shade_surface(
        grid, Workspace(world_from_workspace=place), view.camera.moved(place), size=64
    ).astype(int)
    here = shade_surface(grid, workspace, view.camera, size=64).astype(int)
    assert np.mean(np.abs(there - here) > 2) < 0.01


def test_unseen_space_is_no_wall(view: View, workspace: Workspace, ball_on_table: Callable[..., np.ndarray]):
    grid = ball_on_table(CENTRE, RADIUS)
    fused = grid.copy()
    fused[:, :, 30:] = -1
    shown = shade_surface(free_where_unseen(fused), workspace, view.camera, size=64).astype(int)
    assert np.mean(np.abs(shown - shade_surface(grid, workspace, view.camera, size=64)) > 8) < 0.02


@pytest.mark.parametrize("value", [-1.0, 0.0, 1.0])
def test_a_grid_without_a_surface_is_a_blank_picture(view: View, workspace: Workspace, value: float):
    assert np.all(shade_surface(np.full((40, 40, 40), value), workspace, view.camera, size=64) == 245)
    slice_picture(np.full((40, 40, 40), value), workspace)


def test_a_slice_is_red_inside_and_blue_outside_with_z_up(
    workspace: Workspace, ball_on_table: Callable[..., np.ndarray]
):
    grid = ball_on_table(CENTRE, RADIUS, with_table=False)
    assert abs(workspace.position_of(busiest_slice(grid, workspace)) - CENTRE[1]) < 0.01
    size = 400
    picture = slice_picture(grid, workspace, size=size).astype(int)
    column, row = round(CENTRE[0] / 0.3 * size), round((1 - CENTRE[2] / 0.3) * size)
    red, _, blue = picture[row, column]
    assert red > blue
    red, _, blue = picture[size - 1 - row, size - 1 - column]
    assert blue > red
    rows, columns = np.nonzero((picture == 20).all(axis=-1))
    radii = np.hypot(columns - column, rows - row) / size * 0.3
    assert np.abs(radii - RADIUS).max() < 0.004


@pytest.mark.slow
def test_sheets_hold_all_their_tiles(
    small_views: Views, workspace: Workspace, ball_on_table: Callable[..., np.ndarray]
):
    tile = Tile(np.full((40, 60, 3), 7, dtype=np.uint8), "a caption")
    sheet = contact_sheet([tile] * 5, columns=3, title="five")
    assert (sheet == 7).all(axis=-1).sum() >= 5 * 40 * 60
    grasp = Grasp(rigid(DOWN, (0.15, 0.15, 0.08)), 0.05, 0.9)
    assert overlay_sheet(small_views, [grasp] * 7, GRIPPER).shape[1] > 2 * 640
    assert overlay_sheet(small_views, [], GRIPPER).ndim == 3
    grid = ball_on_table(CENTRE, RADIUS)
    rows = surface_sheet(small_views, grid, grid)
    assert rows.shape[0] > 2 * 300
    assert rows.shape[1] > 3 * 512
