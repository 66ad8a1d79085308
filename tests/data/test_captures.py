"""Scenes of a real cell: read like the simulator's, but for what no cell knows."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ball_record import ball_record
from neugrasp.data.captures import read_capture, write_capture
from neugrasp.data.labels import GraspLabels
from neugrasp.data.packing import pack
from neugrasp.data.records import write_record
from neugrasp.data.scene_folder import write_scene
from neugrasp.data.scene_sets import open_scenes, read_records
from neugrasp.errors import InputError
from neugrasp.geometry.pose import apply, rigid, rotation_about
from neugrasp.geometry.workspace import USUAL, Workspace
from neugrasp.observation import Views

PLACE = rigid(rotation_about((0, 0, 1), 0.7) @ rotation_about((1, 0, 0), 0.2), (0.4, -0.3, 0.1))
"""Where the workspace lies in the world of a robot."""


def moved(views: Views) -> Views:
    """The same views, described in the world of that robot."""
    frames = tuple(replace(view, camera=view.camera.moved(PLACE)) for view in views.frames)
    return Views(frames, replace(views.workspace, world_from_workspace=PLACE))


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    record = ball_record()
    write_capture(tmp_path / "cell" / "0", moved(record.views()), record.labels)
    write_scene(tmp_path / "cell" / "0" / "targets", moved(record.target_views()))
    return tmp_path / "cell" / "0"


def test_it_is_read_as_the_record_of_the_same_scene(capture: Path):
    record = ball_record().grasp_scene()
    scene = read_capture(capture)
    assert scene.truth is None
    for name in ("points", "quaternions", "widths", "success"):
        assert np.array_equal(getattr(scene.labels, name), getattr(record.labels, name))
    for ours, theirs in ((scene.views, record.views), (scene.targets, record.targets)):
        assert ours is not None
        assert theirs is not None
        for one, other in zip(ours.frames, theirs.frames, strict=True):
            assert np.array_equal(one.image, other.image)
            assert np.array_equal(one.background, other.background)
            np.testing.assert_allclose(
                one.camera.world_from_camera, other.camera.world_from_camera, atol=1e-9
            )


def test_labels_project_to_where_they_are_in_the_photos(capture: Path):
    """In the workspace frame the cameras see a label where, in the robot's world, they see it moved there."""
    scene = read_capture(capture, targets=False)
    assert scene.targets is None
    assert scene.views is not None
    points = scene.labels.points.astype(float)
    for here, there in zip(scene.views.frames, moved(ball_record().views()).frames, strict=True):
        ours, _ = here.camera.project(points)
        theirs, _ = there.camera.project(apply(PLACE, points))
        np.testing.assert_allclose(ours, theirs, atol=1e-6)


def test_a_folder_holds_both_kinds_and_says_which(capture: Path):
    record = ball_record(seed=3)
    write_record(capture.parent / record.name, record)
    scenes = open_scenes(capture.parent)
    assert [scenes.has_truth(index) for index in range(len(scenes))] == [False, True]
    assert [scenes.scene(index).truth is None for index in range(len(scenes))] == [True, False]
    assert scenes.scene(0, "inputs").targets is None
    before = scenes.identity()
    empty = GraspLabels(np.zeros((0, 3)), np.zeros((0, 4)), np.zeros(0), np.zeros(0, bool))
    write_capture(capture, moved(ball_record().views()), empty)
    assert open_scenes(capture.parent).identity() != before
    assert len(open_scenes(capture.parent).scene(0).labels.success) == 0


def test_what_only_the_simulator_knows_is_not_asked_of_it(capture: Path, tmp_path: Path):
    with pytest.raises(InputError, match="0: no simulator made it"):
        list(read_records(capture.parent))
    with pytest.raises(InputError, match="0: no simulator made it"):
        pack([capture.parent], tmp_path / "packed")
    assert not (tmp_path / "packed").exists()


def test_one_view_is_too_few(tmp_path: Path):
    views = ball_record().views()
    write_capture(tmp_path / "one", Views(views.frames[:1], views.workspace), ball_record().labels)
    with pytest.raises(InputError, match=r"one: has 1 view; .* takes 2"):
        read_capture(tmp_path / "one")
    write_scene(tmp_path / "one" / "targets", ball_record().target_views())
    for targets in (True, False):
        assert len(read_capture(tmp_path / "one", targets).views or ()) == 1


def test_targets_of_another_cube_are_refused(capture: Path):
    other = ball_record(workspace=Workspace.with_edge(0.24, 24))
    write_scene(capture / "targets", other.target_views())
    with pytest.raises(InputError, match="targets: is about another cube"):
        read_capture(capture)
    assert read_capture(capture, targets=False).workspace.cube == USUAL.cube


def test_labels_that_do_not_fit_are_named(capture: Path):
    labels = ball_record().labels
    wrong = replace(labels, quaternions=labels.quaternions[:-1])
    write_capture(capture, moved(ball_record().views()), wrong)
    with pytest.raises(InputError, match=r"grasps\.npz: quaternions has shape"):
        read_capture(capture)
    (capture / "grasps.npz").write_bytes(b"no archive")
    with pytest.raises(InputError, match=r"grasps\.npz: damaged"):
        read_capture(capture)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda it: replace(it, points=1000 * it.points), "40 of 40 .* outside of the cube .*millimetres"),
        (
            lambda it: replace(it, points=apply(PLACE, it.points)),
            "40 of 40 .* outside of the cube .*those of the world",
        ),
        (
            lambda it: replace(it, points=it.points - [0, 0, 0.2]),
            "40 of 40 .* outside of the cube; they are in",
        ),
        (lambda it: replace(it, points=it.points - [0, 0, 0.09]), "20 of 20 grasps that held lie below"),
        (lambda it: replace(it, widths=1000 * it.widths), "a grasp held 60 m wide"),
        (lambda it: replace(it, widths=0 * it.widths), "a grasp held 0 m wide"),
        (lambda it: replace(it, quaternions=2 * it.quaternions), "a quaternion has length 2"),
        (lambda it: replace(it, quaternions=0 * it.quaternions), "a quaternion has length 0"),
        (
            lambda it: replace(it, quaternions=np.tile(np.float32([0, 0, 0, 1]), (40, 1))),
            "20 of 20 grasps that held came from below",
        ),
    ],
)
def test_labels_that_can_be_no_grasps_of_this_cube_are_named(capture: Path, change, words: str):
    write_capture(capture, moved(ball_record().views()), change(ball_record().labels))
    with pytest.raises(InputError, match=rf"grasps\.npz: {words}"):
        read_capture(capture)


def test_some_labels_outside_of_the_cube_are_told(capture: Path, caplog: pytest.LogCaptureFixture):
    labels = ball_record().labels
    points = labels.points.copy()
    points[30:] += 0.5
    write_capture(capture, moved(ball_record().views()), replace(labels, points=points))
    assert len(read_capture(capture).labels.success) == 40
    assert "10 of 40 grasp points lie outside of the cube: left out" in caplog.text


@pytest.mark.timeout(20)
def test_labels_that_are_no_file_are_not_waited_for(capture: Path):
    file = capture / "grasps.npz"
    file.unlink()
    with pytest.raises(InputError, match=r"grasps\.npz: missing; it holds the grasps tried"):
        read_capture(capture)
    os.mkfifo(file)
    with pytest.raises(InputError, match=r"grasps\.npz: is a pipe"):
        read_capture(capture)
    file.unlink()
    file.mkdir()
    with pytest.raises(InputError, match=r"grasps\.npz: is a folder"):
        read_capture(capture)
