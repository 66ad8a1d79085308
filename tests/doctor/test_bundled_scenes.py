"""The bundled scenes, rendered, with glass and steel in them, are green: the limits are not too tight."""

from __future__ import annotations

from dataclasses import replace

import pytest

from neugrasp.data.scene_folder import read_scene
from neugrasp.demo.bundled import DemoScene, demo_scenes
from neugrasp.doctor.examination import KnownTable, examine_folder, examine_read
from neugrasp.doctor.findings import Level
from neugrasp.observation import Views

FIRST, *REST = demo_scenes()


@pytest.mark.parametrize(
    "scene",
    [FIRST, *(pytest.param(scene, marks=pytest.mark.slow) for scene in REST)],
    ids=lambda scene: scene.name,
)
def test_bundled_scenes_are_green(scene: DemoScene):
    diagnosis = examine_folder(scene.folder)
    assert diagnosis.level == Level.GREEN, diagnosis.lines(Level.YELLOW)


def without_objects(views: Views) -> Views:
    return replace(views, frames=tuple(replace(view, image=view.background) for view in views.frames))


@pytest.mark.slow
def test_what_is_known_of_the_table_before_there_are_photos_changes_no_finding():
    views = read_scene(FIRST.folder)
    first, second, *others = views.frames
    swapped = (replace(first, image=second.image), replace(second, image=first.image), *others)
    exchanged = (replace(first, image=first.background, background=first.image), second, *others)
    for frames in (views.frames, swapped, exchanged):
        seen = replace(views, frames=frames)
        known = KnownTable.of(without_objects(seen))
        assert known is not None
        told, plain = (examine_read(seen, tags=(), table=table) for table in (known, None))
        assert told.findings == plain.findings
        assert (told.level == Level.RED) == (frames is not views.frames)
