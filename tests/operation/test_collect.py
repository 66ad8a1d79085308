"""`neugrasp collect`: an ordinary data folder, whose outcomes are those of physics, whatever kills it."""

from __future__ import annotations

import hashlib
import multiprocessing
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from collecting import DOWN, Combing, Drawing, collect_a_little, little
from neugrasp.data.captures import read_capture
from neugrasp.data.scene_folder import read_scene
from neugrasp.detection.options import DetectorOptions
from neugrasp.errors import InputError
from neugrasp.evaluation.rounds import Rounds
from neugrasp.geometry.pose import from_quaternion, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.operation.collect import collect, run, wanted
from neugrasp.operation.tried import Tried, labels_of
from neugrasp.simulation.grasp_execution import execute
from neugrasp.simulation.lab import LAB
from neugrasp.simulation.objects import ObjectLibrary, OneFriction
from neugrasp.simulation.physics import World
from neugrasp.training.command import Train
from neugrasp.training.recipes import adapt, tiny
from neugrasp.training.trainer import train


@pytest.fixture(scope="module", autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory) -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NEUGRASP_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def collected(tmp_path_factory: pytest.TempPathFactory, _cache: object) -> Path:
    out = tmp_path_factory.mktemp("set") / "lab"
    collect(little(out), Drawing)
    return out


def content(out: Path) -> dict[str, str]:
    files = [path for path in out.rglob("*") if path.is_file() and not path.name.startswith(".")]
    return {str(p.relative_to(out)): hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(files)}


@pytest.mark.slow
def test_the_folder_holds_photos_and_outcomes_and_nothing_of_the_truth(collected: Path):
    names = {path.name for path in collected.rglob("*") if path.is_file()}
    assert names - {f"{i}.png" for i in range(8)} == {".lock", "collection.json", "scene.json", "grasps.npz"}
    for number in range(3):
        scene = read_capture(collected / "scenes" / f"{number:06d}")
        assert scene.views is not None
        assert len(scene.views) == 8
        assert scene.truth is None
        assert len(scene.labels.success) == 6


@pytest.mark.slow
def test_outcomes_are_those_of_physics(collected: Path):
    """Each grasp tried again, in a world that knows nothing of the collection."""
    gripper, library = Gripper.load("robotiq_2f85"), ObjectLibrary.open(("pybullet", "glassware"))
    assert LAB.friction is not None
    outcomes = []
    with World(Workspace(), OneFriction(library, LAB.friction), gripper) as world:
        for number, kind in enumerate(("pile", "packed", "pile")):
            rounds = Rounds(kind, 5, library, "mixed", "groups8", split="train", domain=LAB)
            scene = rounds.make(number, world).scene
            folder = collected / "scenes" / f"{number:06d}"
            labels, seen = read_capture(folder).labels, read_scene(folder)
            picks = Combing(DetectorOptions(gripper="robotiq_2f85")).detect(seen).grasps
            for i, grasp in enumerate(wanted(picks, 6, np.random.default_rng([5, number]))):
                world.reset(scene)
                trial = execute(world, grasp, allow_contact=True)
                assert trial.success == labels.success[i]
                assert labels.widths[i] == np.float32(trial.width)
                pose = from_quaternion(labels.quaternions[i], labels.points[i])
                np.testing.assert_allclose(pose, grasp.advanced(-gripper.tcp_depth).pose, atol=1e-6)
                outcomes.append(trial.success)
    assert 0 < sum(outcomes) < len(outcomes)


@pytest.mark.slow
def test_the_folder_trains_two_steps(collected: Path, tmp_path: Path):
    small = tiny()
    config = replace(
        adapt(), model=small.model, bfloat16=False, rays=48, carving_rays=16, steps=2, validate_every=1,
        validation_scenes=1, checkpoint_every=1,
    )  # fmt: skip
    course = Train(recipe="adapt", data=(collected,), out=tmp_path / "adapted", loaders=0)
    assert train(course, config=config).is_file()
    assert len((tmp_path / "adapted" / "log.jsonl").read_text().splitlines()) >= 2


@pytest.mark.slow
def test_what_is_there_is_kept_and_the_rest_is_made_the_same(collected: Path, tmp_path: Path):
    out = tmp_path / "again"
    collect(little(out, scenes=1), Drawing)
    first = content(out)
    collect(little(out), Drawing)
    assert first.items() <= content(out).items()
    assert content(out) == content(collected)


@pytest.mark.slow
def test_killed_at_any_instant_it_goes_on_to_the_same_set(collected: Path, tmp_path: Path):
    context, rng, out = multiprocessing.get_context("spawn"), np.random.default_rng(1), tmp_path / "killed"
    for _ in range(6):
        process = context.Process(target=collect_a_little, args=(out,))
        process.start()
        time.sleep(rng.uniform(4, 9))
        process.kill()
        process.join()
        for folder in out.glob("scenes/*"):
            if (folder / "grasps.npz").is_file():
                read_capture(folder)
    collect(little(out), Drawing)
    assert content(out) == content(collected)


@pytest.mark.slow
def test_another_collection_in_the_folder_is_refused_and_the_end_says_what_to_do(collected: Path):
    with pytest.raises(InputError, match="was made with grasps = 6, not 7"):
        collect(replace(little(collected), grasps=7), Drawing)
    with pytest.raises(InputError, match="at least 1"):
        collect(replace(little(collected), scenes=0), Drawing)
    said = run(little(collected)).splitlines()
    assert said[0].startswith(f"3 scenes in {collected}, 18 grasps tried, ")
    assert said[-1].startswith("next: neugrasp train --recipe adapt --init neugrasp --data ")


def test_labels_are_grasp_points_in_the_frame_of_the_cube():
    gripper = Gripper.load("robotiq_2f85")
    place = rigid(DOWN, (1.0, 2.0, 0.5))
    workspace = Workspace(world_from_workspace=place)
    tcp = rigid(DOWN, (0.1, 0.2, 0.12))
    labels = labels_of([Tried(Grasp(place @ tcp, 0.03), True, 0.031)], workspace, gripper)
    np.testing.assert_allclose(labels.points, [[0.1, 0.2, 0.12 + gripper.tcp_depth]], atol=1e-6)
    np.testing.assert_allclose(from_quaternion(labels.quaternions[0])[:3, :3], DOWN, atol=1e-6)
    assert labels.widths[0] == np.float32(0.031)
    assert len(labels_of([], workspace, gripper).success) == 0


def test_picks_come_first_and_others_lie_beside_them(rng: np.random.Generator):
    picks = Grasps.of(Grasp(rigid(DOWN, (x, 0.1, 0.1)), 0.03, x) for x in (0.05, 0.15, 0.25))
    tried = wanted(picks, 8, rng)
    assert len(tried) == 8
    assert {grasp.position[0] for grasp in tried[:3]} == {0.05, 0.15, 0.25}
    for grasp in tried[3:]:
        apart = np.abs(picks.positions - grasp.position).max(axis=1).min()
        assert 0 < apart <= 0.012
        np.testing.assert_allclose(grasp.approach, (0, 0, -1), atol=1e-9)
    assert wanted(picks[:0], 8, rng) == []
    many = Grasps.of(Grasp(rigid(DOWN, (0.1, 0.1, 0.1)), 0.03, i / 100) for i in range(100))
    for _ in range(20):
        scores = {grasp.score for grasp in wanted(many, 20, rng)}
        assert {grasp.score for grasp in many[-9:]} <= scores
        assert min(scores) < 0.7
    assert len(wanted(picks, 2, rng)) == 2
