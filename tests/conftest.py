"""What many tests need: the cube, cameras around it, a scene to read, and a table with a ball."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

# Lets all tests share `ball_record` and others.
sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "tools")]

import shape_checker

# First of all: what is imported before it is not checked.
shape_checker.install()

from neugrasp.data.records import Record
from neugrasp.data.scene_folder import write_scene
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.view_sets import view_set
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import View, Views

# The same examples in every run, however slow the machine is;
# `--hypothesis-profile=default --hypothesis-seed=N` draws others.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


@pytest.fixture
def workspace() -> Workspace:
    return Workspace()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture
def cameras(workspace: Workspace, rng: np.random.Generator) -> list[Camera]:
    """The four cameras of the released code's evaluation, 640 x 360."""
    return view_set("released", workspace, rng)


@pytest.fixture
def small_views(workspace: Workspace, cameras: list[Camera], rng: np.random.Generator) -> Views:
    """Four photos of noise, 64 x 36 pixels, from the released arc."""
    views = []
    for camera in cameras:
        small = camera.cropped_and_resized((-0.5, -0.5, 639.5, 359.5), 64, 36)
        small = Camera(small.intrinsics, small.world_from_camera, 64, 36)
        image, background = rng.integers(0, 256, size=(2, 36, 64, 3), dtype=np.uint8)
        views.append(View(small, image, background))
    return Views(tuple(views), workspace)


@pytest.fixture
def scene_folder(tmp_path: Path, small_views: Views) -> Path:
    """`small_views` on disk."""
    folder = tmp_path / "scene"
    write_scene(folder, small_views)
    return folder


@pytest.fixture
def ball_on_table(workspace: Workspace) -> Callable[..., np.ndarray]:
    """A function of centre and radius in metres that gives the distance grid of table and ball."""

    def grid(centre: tuple[float, float, float], radius: float, with_table: bool = True) -> np.ndarray:
        points = workspace.voxel_centres()
        distance = np.linalg.norm(points - centre, axis=-1) - radius
        if with_table:
            distance = np.minimum(distance, points[..., 2] - workspace.table_height)
        return (distance / workspace.truncation).clip(-1, 1).astype(np.float32)

    return grid


@pytest.fixture
def make_record() -> Callable[..., Record]:
    """`ball_record`, as a fixture."""
    from ball_record import ball_record

    return ball_record
