"""Each figure is one command, shows something, and says what it shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image as Picture

from neugrasp import cli
from neugrasp.data.records import Record, write_record
from neugrasp.detection.contract import Detection
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.errors import InputError
from neugrasp.figures import features, priors, trajectory
from neugrasp.figures.features import feature_maps, paint, sample
from neugrasp.figures.figure_inputs import FigureInput, open_figure_input
from neugrasp.figures.priors import itself, one_colour, replace_backgrounds, variants
from neugrasp.figures.trajectory import hand_stages, trajectory_figure
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.model.checkpoint import save_checkpoint
from neugrasp.model.network import NeuGrasp
from neugrasp.training.recipes import tiny

REDNESS = 60
"""Of the ball, and of nothing else."""
CHANGES = {"with.safetensors": {}, "without.safetensors": {"use_backgrounds": False}}


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with networks that know nothing: one with backgrounds, one without."""
    folder = tmp_path_factory.mktemp("weights")
    for name, change in CHANGES.items():
        torch.manual_seed(0)
        save_checkpoint(folder / name, NeuGrasp(replace(tiny().model, **change)), {})
    return folder


@pytest.fixture
def ball(tmp_path: Path, make_record: Callable[..., Record]) -> Path:
    """The folder of a record: a red ball on a checkered table, at the size of the tiny network."""
    record = make_record(x=0.16, y=0.13, size=tiny().model.image_size)
    is_red = record.images[..., 0].astype(int) - record.images[..., 1] > REDNESS
    record = replace(record, masks=is_red.astype(np.int8))
    write_record(tmp_path / "ball", record)
    return tmp_path / "ball"


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small pictures of few pixels, which are drawn faster."""
    monkeypatch.setattr(features, "PIXELS", 100)
    monkeypatch.setattr(priors, "SIZE", 80)
    monkeypatch.setattr(trajectory, "SIZE", (200, 160))


@pytest.fixture
def source(ball: Path) -> FigureInput:
    return open_figure_input(str(ball), 1)


@pytest.mark.slow
@pytest.mark.parametrize("which", ["features", "priors", "trajectory"])
def test_one_command_writes_the_picture(
    which: str, ball: Path, weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    model = str(weights / "with.safetensors")
    assert cli.main(["figure", which, "--scene", str(ball), "--weights", model, "--view", "2"]) == 0
    picture = np.asarray(Picture.open(tmp_path / f"outputs/figures/{which}.png"))
    assert picture.std() > 10
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 200


@pytest.mark.slow
def test_mistakes_are_named(ball: Path, weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    def refused(*arguments: object) -> str:
        assert cli.main(["figure", *map(str, arguments)]) == 2
        return capsys.readouterr().err

    assert "bundled scene (packed_mixed" in refused("features", "--scene", "nowhere")
    assert "has the photos 0 to 3" in refused("features", "--scene", ball, "--view", 7)
    assert "--without is for the figure priors" in refused("trajectory", "--without", "x")
    assert "ends with .png" in refused("trajectory", "--out", tmp_path / "a.jpg")
    plain = weights / "without.safetensors"
    assert "without residual attention" in refused("features", "--scene", ball, "--weights", plain)
    assert "give it as --without" in refused("priors", "--scene", ball, "--weights", plain)


@pytest.mark.slow
def test_objects_and_table_are_where_the_masks_say(source: FigureInput, weights: Path):
    maps = feature_maps(source, NeuGraspDetector.load(weights / "with.safetensors").model)
    assert maps.are_known
    assert maps.scene.shape[:3] == maps.attentive.shape[:3] == maps.kinds.shape == maps.measured.shape
    assert set(np.unique(maps.kinds)) == {0, 1}
    size = maps.kinds.shape[1]
    photo = maps.photos[1].reshape(size, 64 // size, size, 64 // size, 3).mean(axis=(1, 3))
    redness = 255 * (photo[..., 0] - photo[..., 1])
    is_ball = maps.kinds[1] == 1
    assert redness[is_ball].min() > REDNESS / 2 > redness[~is_ball].mean()


@pytest.mark.slow
def test_without_masks_what_changed_counts_as_object(source: FigureInput, weights: Path):
    model = NeuGraspDetector.load(weights / "with.safetensors").model
    known, guessed = feature_maps(source, model), feature_maps(replace(source, truth=None), model)
    assert not guessed.are_known
    is_ball = known.kinds > 0
    assert (guessed.kinds > 0)[is_ball].mean() > 0.8
    assert (guessed.kinds > 0)[~is_ball].mean() < 0.2


def test_as_many_pixels_of_objects_as_of_the_rest(rng: np.random.Generator):
    kinds = np.repeat([0, 1, 2], [800, 150, 50])
    measured = np.arange(1000) % 2 == 0
    for most, objects in ((100, 50), (300, 100)):
        chosen = sample(kinds, measured, rng, most)
        assert len(set(chosen)) == len(chosen) == most
        assert np.count_nonzero(kinds[chosen]) == objects
        assert measured[chosen].all()


def test_every_kind_has_its_colour():
    assert len(np.unique(paint(np.arange(8)), axis=0)) == 8


def test_the_background_is_taken_away_and_nothing_else(source: FigureInput):
    for change in (itself, one_colour):
        for view, old in zip(
            replace_backgrounds(source.views, change).frames, source.views.frames, strict=True
        ):
            np.testing.assert_array_equal(view.image, old.image)
            assert view.camera is old.camera
            assert view.background.shape == old.background.shape
            assert not np.array_equal(view.background, old.background)


@pytest.mark.slow
def test_two_models_are_compared_where_two_are_given(source: FigureInput, weights: Path):
    full, plain = (NeuGraspDetector.load(weights / name) for name in CHANGES)
    words = [variant.words for variant in variants(source.views, full, plain)]
    assert words == ["with the empty table", "trained without the empty table"]
    assert len(variants(source.views, full, None)) == 3
    with pytest.raises(InputError, match="one trained without is wanted"):
        variants(source.views, full, full)


def test_the_hand_comes_open_closes_and_leaves(workspace_grasp: Grasp):
    gripper = Gripper.load("panda")
    before, after, at = (stage for stage, _ in hand_stages(workspace_grasp, gripper))
    assert before.width == gripper.max_opening
    assert at is workspace_grasp
    np.testing.assert_allclose(at.position - before.position, 0.05 * at.approach, atol=1e-9)
    # From the side, straight up.
    np.testing.assert_allclose(after.position - at.position, (0, 0, 0.10), atol=1e-9)


@pytest.fixture
def workspace_grasp() -> Grasp:
    """From the side: x up, z along +y."""
    pose = np.eye(4)
    pose[:3, :3] = np.array([(0, 0, 1), (1, 0, 0), (0, 1, 0)]).T
    pose[:3, 3] = (0.15, 0.13, 0.1)
    return Grasp(pose, 0.04, 0.9)


@pytest.mark.slow
def test_a_scene_without_grasps_and_one_with_are_drawn(source: FigureInput, workspace_grasp: Grasp):
    assert source.truth is not None
    gripper, workspace = Gripper.load("panda"), source.views.workspace
    none = Detection(Grasps.of(()), workspace, gripper, source.truth.tsdf, {"off_the_surface": 64000}, 0.1)
    one = replace(none, grasps=Grasps.of([workspace_grasp]))
    empty, full = (trajectory_figure(source, detection, gripper) for detection in (none, one))
    assert empty.shape == full.shape
    height, width = empty.shape[:2]
    # The right half has the hand; the left one, with the cameras, is the same. Below are words.
    differs = (empty != full).any(axis=-1)[: height - 50]
    assert differs[:, width // 2 :].mean() > 0.2
    assert not differs[:, : width // 2 - 8].any()
