"""The viewer in a real browser: what is drawn is there, and a click says what it should."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from browsers import no_browser
from neugrasp import cli
from neugrasp.geometry.pose import apply, inverse
from neugrasp.viewer.app import PAGE_ASPECT, ViewerApp
from neugrasp.viewer.browser import Browser
from neugrasp.viewer.drawing import grasps_of
from neugrasp.viewer.scene_data import SceneData
from neugrasp.viewer.settings import Settings
from neugrasp.viewer.viewpoint import viewpoint

from .conftest import BALL, WORLD_FROM_WORKSPACE, Capture

WINDOW = (760, 420)
PICTURE = (320, 200)
PATIENCE = 300


MISSING = no_browser("viser")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(bool(MISSING), reason=MISSING),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:websockets.*"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def shown(data: SceneData) -> Iterator[tuple[ViewerApp, Browser]]:
    settings = Settings().suited_to(data)
    with ViewerApp(data, settings, port=8290) as show, Browser(show.scene.url, size=WINDOW) as browser:
        show.scene.wait_for_visitor()
        browser.settle()
        yield show, browser


@pytest.fixture
def show(shown: tuple[ViewerApp, Browser], data: SceneData) -> ViewerApp:
    shown[0].update(Settings().suited_to(data))
    return shown[0]


def red(picture: np.ndarray) -> int:
    """Pixels of the ball, which its photos show red."""
    r, g, b = picture.astype(float).transpose(2, 0, 1)
    return int(((r > 1.8 * g) & (r > 1.8 * b)).sum())


def green(picture: np.ndarray) -> int:
    """Pixels of grasps with a high score."""
    r, g, b = picture.astype(float).transpose(2, 0, 1)
    return int(((g > 1.15 * r) & (g > 1.25 * b)).sum())


def until(condition: Callable[[], bool]) -> bool:
    end = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < end:
        time.sleep(0.1)
    return condition()


def test_surface_grasps_and_cameras_are_in_the_picture_and_go_when_they_are_hidden(show: ViewerApp):
    assert {"table", "cube", "surface", "grasps/000", "grasps/001", "grasps/002"} < set(show.scene.names)
    assert {f"cameras/{i}/photo" for i in range(4)} < set(show.scene.names)
    everything = show.picture(*PICTURE)
    assert everything.shape == (PICTURE[1], PICTURE[0], 3)
    assert (everything[:3, :3] == 255).all()
    assert green(everything) > 200

    show.update(replace(show.settings, threshold=0.99))
    assert not any(name.startswith("grasps") for name in show.scene.names)
    no_grasps = show.picture(*PICTURE)
    assert green(no_grasps) < 20
    assert red(no_grasps) > 100

    show.update(replace(show.settings, shows_surface=False, shows_cameras=False))
    bare = show.picture(*PICTURE)
    # The photos show the ball, too: nothing red is left without them.
    assert red(bare) < 0.05 * red(no_grasps)
    assert np.abs(bare.astype(int) - no_grasps).max() > 100


def test_a_photo_is_drawn_at_its_camera(show: ViewerApp, data: SceneData):
    show.update(replace(show.settings, shows_surface=False, most=0))
    with_photos = show.picture(*PICTURE).astype(int)
    show.update(replace(show.settings, shows_cameras=False))
    changed = np.abs(with_photos - show.picture(*PICTURE)).max(axis=-1) > 40
    for view in data.views:
        column, row = pixel_of(data, view.camera.centre, PICTURE, 1.6)
        around = changed[max(0, row - 6) : row + 7, max(0, column - 6) : column + 7]
        assert around.any()
    assert not changed[int(0.75 * PICTURE[1]) :].any()


def test_a_click_on_a_gripper_selects_it(shown: tuple[ViewerApp, Browser], show: ViewerApp, data: SceneData):
    show.update(replace(show.settings, most=1, hand="whole hand"))
    show.picture(*PICTURE)
    node = grasps_of(data, show.settings)[0]
    spot = node.surface.vertices.mean(axis=0)
    assert shown[1].screenshot().shape == (WINDOW[1], WINDOW[0], 3)
    shown[1].click(*pixel_of(data, spot, WINDOW, PAGE_ASPECT))
    assert until(lambda: show.settings.selected is data.moments[0].grasps[0])
    assert until(lambda: "selected" in show.scene.names)
    assert until(lambda: "0.950" in show.panel.words)
    assert "60 mm" in show.panel.words


def test_shift_and_a_click_choose_an_object_and_its_region(
    shown: tuple[ViewerApp, Browser], show: ViewerApp, data: SceneData
):
    """The ball is the only thing; beside it there is none, and all is as before."""
    show.update(replace(show.settings, most=0))
    show.picture(*PICTURE)
    shown[1].click(*pixel_of(data, BALL, WINDOW, PAGE_ASPECT), shift=True)
    assert until(lambda: show.settings.region is not None)
    assert until(lambda: "region" in show.scene.names)
    region = show.settings.region
    place = apply(WORLD_FROM_WORKSPACE, BALL)
    assert all(low < x < high for low, x, high in zip(region[:3], place, region[3:], strict=True))
    words = "--region " + " ".join(f"{edge:g}" for edge in region)
    assert until(lambda: words in show.panel.words)
    shown[1].click(*pixel_of(data, (0.03, 0.03, 0.05), WINDOW, PAGE_ASPECT), shift=True)
    assert until(lambda: show.settings.region is None)


def test_the_sliders_move_the_scene(show: ViewerApp):
    show.panel.set("threshold", 0.7)
    assert until(lambda: "grasps/002" not in show.scene.names)
    assert "grasps/001" in show.scene.names
    assert "2 of 3 grasps drawn" in show.panel.words
    show.panel.set("slice_axis", "z")
    assert until(lambda: "slice" in show.scene.names)
    show.panel.set("threshold", 0.6)
    show.panel.set("slice_axis", "none")
    assert until(lambda: "slice" not in show.scene.names and "grasps/002" in show.scene.names)


def test_the_command_writes_a_picture(kept_capture: Capture, tmp_path: Path):
    out = tmp_path / "docs" / "view.png"
    arguments = ["view", str(kept_capture.prediction), "--screenshot", str(out), "--size", "320", "200"]
    assert cli.main([*arguments, "--port", "8291"]) == 0
    with Picture.open(out) as picture:
        pixels = np.asarray(picture.convert("RGB"))
    assert pixels.shape == (200, 320, 3)
    assert green(pixels) > 200


def pixel_of(data: SceneData, spot: np.ndarray, size: tuple[int, int], aspect: float) -> tuple[int, int]:
    """Column and row at which the first look shows a place of the workspace."""
    eye = viewpoint(data, aspect)
    x, y, z = apply(inverse(eye.pose()), spot)
    focal = size[1] / 2 / np.tan(eye.field_of_view / 2)
    return round(size[0] / 2 + focal * x / z), round(size[1] / 2 + focal * y / z)
