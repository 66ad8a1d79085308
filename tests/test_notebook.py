"""What a notebook shows: one line that says what a thing is, and pictures."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image as Picture

from neugrasp.detection.contract import Detection
from neugrasp.geometry.pose import rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Frame, Views
from neugrasp.pictures import colour_of_score

GRASP = Grasp(rigid(np.diag([1.0, -1, -1]), (0.1, -0.2, 0.3)), 0.051, 0.976)


def detection(count: int) -> Detection:
    grid = np.zeros((40, 40, 40), np.float32)
    rejected, seconds = {"off_the_surface": 63_000}, {"a": 0.5, "b": 0.25}
    gripper = Gripper.load("panda")
    return Detection(Grasps.of([GRASP] * count), Workspace(), gripper, grid, rejected, 0.5, 0.85, seconds)


def test_reprs_are_one_line(small_views: Views):
    things = (small_views, replace(small_views, source="my_scene"), *small_views.frames, GRASP, detection(3))
    for thing in things:
        assert len(repr(thing)) < 120
        assert len(repr(thing).splitlines()) == 1
    assert repr(GRASP) == (
        "Grasp(score 0.98, width 51 mm, TCP (+0.100, -0.200, +0.300) m, approach (+0.00, +0.00, -1.00))"
    )
    assert repr(detection(3)) == "Detection(3 grasps, the best with score 0.98; 0.8 s)"
    assert repr(detection(0)) == "Detection(0 grasps; 0.8 s)"
    assert repr(replace(small_views, source="my_scene")).startswith("Views(4 frames of my_scene, ")


def test_photos_are_shown(small_views: Views):
    view = small_views.frames[0]
    with Picture.open(io.BytesIO(view._repr_png_())) as shown:
        pixels = np.asarray(shown)
    np.testing.assert_array_equal(pixels, np.concatenate([view.image, view.background], axis=1))
    camera = replace(view.camera, width=120, height=60)
    black = np.zeros((60, 120, 3), np.uint8)
    wide = replace(view, camera=camera, image=black, background=black)
    with Picture.open(io.BytesIO(Views((view, wide), small_views.workspace)._repr_png_())) as shown:
        width, height = view.image.shape[1], view.image.shape[0]
        assert shown.size == (round(240 * width / height) + 480, 480)


@pytest.mark.parametrize(("count", "listed"), [(0, 0), (3, 3), (25, 10)])
def test_grasps_are_listed_with_their_numbers(count: int, listed: int):
    shown = detection(count)._repr_html_()
    assert shown.count("<tr>") == listed + (listed > 0)
    assert ("<td>1</td><td>0.976</td><td>51</td><td>+0.100 -0.200 +0.300</td>" in shown) is (count > 0)
    assert ("15 more" in shown) is (count == 25)
    assert "63,000 off the surface" in shown


@pytest.mark.slow
def test_a_surface_is_shown_with_its_grasps(ball_on_table: Callable[..., np.ndarray]):
    grid = ball_on_table((0.15, 0.15, 0.08), 0.03)
    assert replace(detection(1), tsdf=None)._repr_png_() is None
    above = Grasp(rigid(np.diag([1.0, -1, -1]), (0.15, 0.15, 0.1)), 0.06, 1.0)
    shown = []
    for grasps in ([], [above]):
        found = replace(detection(0), tsdf=grid, grasps=Grasps.of(grasps))
        with Picture.open(io.BytesIO(found._repr_png_())) as picture:
            shown.append(np.asarray(picture.convert("RGB")).astype(int))
    assert shown[0].shape == shown[1].shape
    assert (np.abs(shown[1] - colour_of_score(1.0)).max(axis=-1) <= 6).sum() > 300
    assert (shown[0] != shown[1]).any()


def test_the_way_of_the_hand_is_told_by_the_workspace():
    """A detector of one's own need not know which way is up."""
    lying = Workspace(world_from_workspace=rigid([[0, 0, 1], [1, 0, 0], [0, 1, 0]]))
    found = replace(detection(1), workspace=lying)
    assert found.grasps[0].up == (1.0, 0.0, 0.0)
    np.testing.assert_allclose(found.grasps[0].retreat[:3, 3], GRASP.position + np.array((0.1, 0, 0)))
    assert found.to_dict()["up"] == [1, 0, 0]


def test_a_round_without_photos_shows_none(small_views: Views):
    assert Frame(small_views.frames[0].camera)._repr_png_() is None
