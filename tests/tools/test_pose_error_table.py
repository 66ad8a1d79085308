"""The errors are as large as they are called, and the table counts what was executed."""

from __future__ import annotations

import numpy as np
import pytest

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import inverse, look_at
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import View, Views
from pose_error_table import ERRORS, Error, table_of


@pytest.fixture
def views() -> Views:
    photo = np.zeros((48, 64, 3), dtype=np.uint8)
    intrinsics = np.array([[60.0, 0, 31.5], [0, 60, 23.5], [0, 0, 1]])
    camera = Camera(intrinsics, look_at((0.3, 0, 0.5), Workspace().centre), 64, 48)
    return Views((View(camera, photo, photo),), Workspace())


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: error.name)
def test_an_error_is_as_large_as_its_name_says(views: Views, error: Error, rng: np.random.Generator):
    (true,), (told,) = views.frames, error.applied(views, rng).frames
    wrong = inverse(true.camera.world_from_camera) @ told.camera.world_from_camera
    angle = np.rad2deg(np.arccos(np.clip((np.trace(wrong[:3, :3]) - 1) / 2, -1, 1)))
    assert angle == pytest.approx(error.deg, abs=1e-5)
    assert 1000 * np.linalg.norm(wrong[:3, 3]) == pytest.approx(error.mm)
    assert told.camera.intrinsics[0, 0] == pytest.approx(60 * error.focal)
    assert told.camera.intrinsics[0, 2] == 31.5
    raised = error.applied(views, rng).workspace.world_from_workspace[2, 3]
    assert 1000 * raised == pytest.approx(error.height_mm)


def test_the_names_of_errors_differ():
    assert len({error.name for error in ERRORS}) == len(ERRORS)


def test_the_table_counts_grasps_and_silent_rounds():
    lines = [
        {"error": "1 deg", "table": "plain", "found": 4, "reasons": ["success", "slipped", "success"]},
        {"error": "1 deg", "table": "plain", "found": 0, "reasons": []},
        {"error": "1 deg", "table": "patterned", "found": 1, "reasons": ["success"]},
    ]
    row = table_of(lines).splitlines()[-1]
    assert row.startswith("| 1 deg | 100 (21 to 100), 1 of 1 | 67 (21 to 94), 2 of 3; 1 of 2 rounds without")
    assert "75 (30 to 95), 3 of 4" in row
