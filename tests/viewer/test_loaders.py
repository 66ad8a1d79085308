"""What the viewer finds at a path."""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from ball_record import ball_record
from neugrasp.data.records import write_record
from neugrasp.data.world import Body, Scene
from neugrasp.errors import InputError
from neugrasp.evaluation.episode import write_episode
from neugrasp.geometry.view_sets import view_set
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.viewer.command import Viewer
from neugrasp.viewer.drawing import nodes_of
from neugrasp.viewer.loaders import open_scene_data
from neugrasp.viewer.primitives import MeshNode
from neugrasp.viewer.scene_data import SceneData
from neugrasp.viewer.settings import Settings
from rounds_by_hand import attempt, played

from .conftest import BALL, RADIUS, SCORES, Capture, moved_views


def opened(path: Path, **options: object) -> SceneData:
    return open_scene_data(Viewer(path, **options))  # type: ignore[arg-type]


def test_a_prediction_knows_its_scene_and_all_of_it_is_brought_to_the_workspace_frame(capture: Capture):
    data = opened(capture.prediction)
    grasps = data.moments[0].grasps
    assert [marker.grasp.score for marker in grasps] == pytest.approx(SCORES)
    assert np.allclose([marker.grasp.position for marker in grasps], BALL, atol=1e-6)
    for view, expected in zip(data.views, ball_record(size=128).cameras, strict=True):
        assert np.allclose(view.camera.world_from_camera, expected.world_from_camera, atol=1e-6)
    assert "3 grasps" in data.moments[0].caption


def test_a_prediction_whose_scene_is_gone_is_shown_without_photos(
    capture: Capture, tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    capture.scene.rename(tmp_path / "elsewhere")
    with caplog.at_level(logging.WARNING):
        data = opened(capture.prediction)
    assert not data.views
    assert len(data.moments[0].grasps) == 3
    assert "--scene DIR" in caplog.text
    assert len(opened(capture.prediction, scene=tmp_path / "elsewhere").views) == 4


def test_a_scene_from_another_place_is_refused(capture: Capture, tmp_path: Path):
    from neugrasp.data.scene_folder import write_scene

    write_scene(tmp_path / "other", moved_views(np.eye(4)))
    with pytest.raises(InputError, match="its workspace lies elsewhere than that of other"):
        opened(capture.prediction, scene=tmp_path / "other")


def test_a_scene_is_a_capture_without_a_surface(capture: Capture):
    for path in (capture.scene, capture.scene / "scene.json"):
        data = opened(path)
        assert len(data.views) == 4
        assert data.moments[0].tsdf is None
        assert not data.truth


def test_a_record_brings_its_truth_with_grasps_at_the_tcp(tmp_path: Path):
    record = ball_record(size=64)
    write_record(tmp_path / "record", record)
    gripper = Gripper.load("panda")
    truth = opened(tmp_path / "record").truth
    assert truth.tsdf is not None
    assert len(truth.grasps) == np.count_nonzero(record.labels.success)
    for marker, point in zip(truth.grasps, record.labels.points, strict=False):
        # The hand comes from above: the TCP lies below the grasp point.
        assert np.allclose(marker.grasp.position, point - (0, 0, gripper.tcp_depth), atol=1e-6)


@pytest.mark.slow
def test_the_truth_is_drawn_when_it_is_asked_for(tmp_path: Path):
    write_record(tmp_path / "record", ball_record(size=64))
    data = opened(tmp_path / "record")
    settings = Settings().suited_to(data)
    asked = replace(settings, shows_truth=True, shows_true_grasps=True, most=4)
    added = {n.name: n for n in nodes_of(data, asked)}
    assert not {node.name for node in nodes_of(data, settings)} - set(added)
    assert {name for name in added if name.startswith("truth")} == {
        "truth/surface",
        *(f"truth/grasps/{i:03d}" for i in (0, 6, 13, 19)),
    }
    surface = added["truth/surface"]
    assert isinstance(surface, MeshNode)
    free = surface.surface.vertices[surface.surface.vertices[:, 2] > 0.062]
    assert np.abs(np.linalg.norm(free - BALL, axis=-1) - RADIUS).max() < 0.002


@pytest.fixture
def evaluation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A round by hand: two boxes, a failure, a success, one box left."""
    monkeypatch.setenv("NEUGRASP_CACHE", str(tmp_path / "cache"))
    first = Body("glassware", "jar_200", 1.0, (0.1, 0.1, 0.1), (0.0, 0.0, 0.0, 1.0))
    second = Body("glassware", "box_201", 1.0, (0.2, 0.2, 0.1), (0.0, 0.0, 0.0, 1.0))
    both, one = (asdict(Scene("packed", 0, bodies)) for bodies in ((first, second), (second,)))
    episode = played(3, "-+", objects=2, left=one)
    attempts = tuple(attempt(3, i, i == 1, before=both) for i in range(2))
    folder = tmp_path / "evaluation"
    write_episode(folder / "rounds" / "000003.json", type(episode)(**{**vars(episode), "attempts": attempts}))
    facts = {
        "detector": "oracle",
        "scene": "packed",
        "materials": "diffuse",
        "views": "released",
        "gripper": "panda",
        "seed": 0,
        "object_sets": ["glassware"],
    }
    (folder / "run.json").write_text(json.dumps(facts))
    return folder


def test_a_round_has_a_moment_for_each_attempt_and_one_for_the_end(evaluation: Path):
    data = opened(evaluation, round=3)
    captions = [moment.caption for moment in data.moments]
    assert captions == [
        "attempt 1 of 2: slipped on lifting",
        "attempt 2 of 2: success",
        "the end: table empty",
    ]
    assert [[c.outcome for c in moment.grasps] for moment in data.moments] == [[False], [True], []]
    assert [len(moment.solids) for moment in data.moments] == [2, 2, 1]
    # The body that stays keeps its colour, and lies where it was put.
    assert data.moments[0].solids[1].colour == data.moments[2].solids[0].colour
    middle = data.moments[2].solids[0].surface.vertices.mean(axis=0)
    assert np.linalg.norm(middle[:2] - 0.2) < 0.03
    assert opened(evaluation / "rounds" / "000003.json").title == data.title


def test_the_cameras_of_a_round_are_those_that_it_was_played_with(evaluation: Path):
    views = opened(evaluation, round=3).views
    expected = view_set("released", Workspace(), np.random.default_rng(0))
    for view, camera in zip(views, expected, strict=True):
        assert np.allclose(view.camera.world_from_camera, camera.world_from_camera)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda c: (c.prediction / "tsdf.npz").unlink(), "tsdf.npz: missing; a prediction needs"),
        (lambda c: (c.prediction / "tsdf.npz").write_bytes(b"no"), "tsdf.npz"),
        (lambda c: (c.prediction / "grasps.json").write_text("{}"), r"grasps\.json: format is None"),
        (lambda c: (c.prediction / "grasps.json").unlink(), "nothing to show; give a scene"),
    ],
)
def test_what_cannot_be_shown_is_named(capture: Capture, spoil, message: str):
    spoil(capture)
    with pytest.raises(InputError, match=message):
        opened(capture.prediction)


def test_a_round_or_a_moment_that_does_not_exist(evaluation: Path):
    with pytest.raises(InputError, match=r"000007.json: cannot be read"):
        opened(evaluation, round=7)
    with pytest.raises(InputError, match="has moments 0 to 2"):
        Settings(moment=3).suited_to(opened(evaluation, round=3))
