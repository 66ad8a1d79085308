"""A ball on a checkered table: its capture, its prediction in a world of its own, and its data."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from ball_record import ball_record
from neugrasp.data.scene_folder import read_scene, write_scene
from neugrasp.detection.contract import Detection
from neugrasp.geometry.pose import Array, rigid, rotation_about
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Views
from neugrasp.viewer.command import Viewer
from neugrasp.viewer.loaders import open_scene_data
from neugrasp.viewer.scene_data import SceneData

BALL = np.array([0.15, 0.15, 0.08])
RADIUS = 0.03
SCORES = (0.95, 0.8, 0.6)
WORLD_FROM_WORKSPACE = rigid(rotation_about((0.2, -0.1, 1.0), 0.7), (0.5, -0.2, 0.9))
"""The user's world is not the workspace frame, nor is its z axis up."""


@dataclass(frozen=True)
class Capture:
    """A scene and what was predicted from it, on disk."""

    scene: Path
    prediction: Path


def moved_views(world_from_workspace: Array = WORLD_FROM_WORKSPACE) -> Views:
    """The four photos of the ball with everything moved to another world."""
    views = ball_record(size=128).views()
    moved = tuple(replace(v, camera=v.camera.moved(world_from_workspace)) for v in views.frames)
    return Views(moved, replace(views.workspace, world_from_workspace=world_from_workspace))


def ball_grasps() -> tuple[Grasp, ...]:
    """Three grasps of the ball from above, turned about the vertical; workspace frame."""
    down = np.diag([1.0, -1.0, -1.0])
    turns = (0.0, 0.6, 1.2)
    poses = [rigid(rotation_about((0, 0, 1), turn) @ down, BALL) for turn in turns]
    return tuple(Grasp(pose, 2 * RADIUS, score) for pose, score in zip(poses, SCORES, strict=True))


@pytest.fixture(scope="session")
def ball_tsdf() -> np.ndarray:
    return ball_record().tsdf


@pytest.fixture(scope="session")
def kept_capture(tmp_path_factory: pytest.TempPathFactory, ball_tsdf: np.ndarray) -> Capture:
    """For tests that change nothing on disk."""
    folder = tmp_path_factory.mktemp("ball")
    scene, prediction = folder / "scene", folder / "prediction"
    write_scene(scene, moved_views())
    grasps = tuple(grasp.moved(WORLD_FROM_WORKSPACE) for grasp in ball_grasps())
    views, gripper = read_scene(scene), Gripper.load("panda")
    detection = Detection(Grasps.of(grasps), views.workspace, gripper, ball_tsdf, source=views.source)
    prediction.mkdir()
    detection.write(prediction, views)
    return Capture(scene, prediction)


@pytest.fixture
def capture(tmp_path: Path, kept_capture: Capture) -> Capture:
    """A copy to be spoilt."""
    copied = Capture(tmp_path / "scene", tmp_path / "prediction")
    shutil.copytree(kept_capture.scene, copied.scene)
    shutil.copytree(kept_capture.prediction, copied.prediction)
    file = copied.prediction / "grasps.json"
    file.write_text(file.read_text().replace(str(kept_capture.scene.resolve()), str(copied.scene)))
    return copied


@pytest.fixture(scope="session")
def data(kept_capture: Capture) -> SceneData:
    return open_scene_data(Viewer(kept_capture.prediction))
