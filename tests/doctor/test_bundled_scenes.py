"""The bundled scenes, rendered, with glass and steel in them, are green: the limits are not too tight."""

from __future__ import annotations

import pytest

from neugrasp.demo.bundled import DemoScene, demo_scenes
from neugrasp.doctor.examination import examine_folder
from neugrasp.doctor.findings import Level

FIRST, *REST = demo_scenes()


@pytest.mark.parametrize(
    "scene",
    [FIRST, *(pytest.param(scene, marks=pytest.mark.slow) for scene in REST)],
    ids=lambda scene: scene.name,
)
def test_bundled_scenes_are_green(scene: DemoScene):
    diagnosis = examine_folder(scene.folder)
    assert diagnosis.level == Level.GREEN, diagnosis.lines(Level.YELLOW)
