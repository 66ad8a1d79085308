"""Whole evaluations: the same metrics whatever the workers and the accidents on the way."""

from __future__ import annotations

import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import torch

from neugrasp import cli
from neugrasp.detection import registry
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.detection.registry import GROUP, PHOTOS, detector_spec
from neugrasp.errors import InputError
from neugrasp.evaluation import run
from neugrasp.evaluation.commands import Evaluate, InspectEpisode
from neugrasp.evaluation.compare import compare
from neugrasp.evaluation.episode import Episode, read_episode
from neugrasp.evaluation.episode_report import write_episode_report
from neugrasp.evaluation.episode_runner import EpisodeRunner
from neugrasp.evaluation.oracle_baselines import Oracle
from neugrasp.evaluation.rounds import Round, Rounds
from neugrasp.evaluation.run import evaluate
from neugrasp.evaluation.scores import TIMES
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.checkpoint import load_checkpoint, save_checkpoint
from neugrasp.model.network import NeuGrasp
from neugrasp.robot.pick import REASONS
from neugrasp.robot.simulated_cameras import TruthCamera
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World
from neugrasp.simulation.renderer import RenderSettings
from neugrasp.training.recipes import tiny
from toy_boxes import AirGrasper

PHOTOGRAPHER = Path(__file__).parent.parent / "simulation"


@pytest.fixture(scope="module", autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory) -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NEUGRASP_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.setenv("OMP_NUM_THREADS", "1")
        patch.syspath_prepend(str(PHOTOGRAPHER))
        yield


@pytest.fixture(scope="module")
def photographers(_cache: object) -> ModuleType:
    import importlib

    return importlib.import_module("noise_renderer")


def small(out: Path, **changes: Any) -> Evaluate:
    config = Evaluate(out=out, detector="antipodal", scene="single", rounds=3, seed=5, workers=1)
    return replace(config, **changes)


def told(out: Path) -> dict[str, Any]:
    """metrics.json but for times, and for a commit that may be made while the tests run."""
    data: dict[str, Any] = json.loads((out / "metrics.json").read_text())
    return {key: value for key, value in data.items() if key not in (*TIMES, "commit")}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, _cache: object) -> Path:
    """Three rounds by one process in one go."""
    out = tmp_path_factory.mktemp("undisturbed")
    evaluate(small(out))
    return out


@pytest.mark.slow
def test_what_is_written_agrees_with_itself(undisturbed: Path):
    metrics = json.loads((undisturbed / "metrics.json").read_text())
    attempts = [json.loads(line) for line in (undisturbed / "attempts.jsonl").read_text().splitlines()]
    wanted = {"detector", "scene", "materials", "strategy", "protocol", "seed", "rounds", "attempts"}
    wanted |= {"successes", "objects", "SR", "FSR", "DR", "SR_ci", "FSR_ci", "DR_ci", "L1", "L1_by_mask"}
    assert wanted | {"seconds_per_round"} <= set(metrics)
    assert metrics["rounds"] == metrics["objects"] == 3
    assert metrics["attempts"] == len(attempts) > 0
    assert metrics["successes"] == sum(attempt["success"] for attempt in attempts)
    assert metrics["strategy"] == "random"
    assert {attempt["reason"] for attempt in attempts} <= set(REASONS)
    failed = sum(metrics["failures"].values())
    assert failed == metrics["attempts"] - metrics["successes"]
    assert sum(metrics["endings"].values()) == 3
    assert set(metrics["L1_by_mask"]) == {"1.0", "0.5", "0.3", "0.1", "0.05"}
    # A measuring stick is told the true surface.
    assert metrics["L1"] < 0.01
    assert "--detector antipodal" in metrics["command"]


@pytest.mark.slow
def test_two_workers_and_a_second_run_give_the_same_metrics(undisturbed: Path, tmp_path: Path):
    evaluate(small(tmp_path / "two", workers=2))
    assert told(tmp_path / "two") == told(undisturbed)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "two" / "rounds").iterdir()}
    evaluate(small(tmp_path / "two"))
    assert told(tmp_path / "two") == told(undisturbed)
    assert all(path.stat().st_mtime_ns == mtime for path, mtime in before.items())


@pytest.mark.slow
def test_rounds_of_training_objects_are_others_and_say_so(undisturbed: Path, tmp_path: Path):
    evaluate(small(tmp_path, split="train", rounds=1))
    assert told(tmp_path)["split"] == "train"
    assert told(tmp_path)["objects_sha256"] != told(undisturbed)["objects_sha256"]
    assert "--split train" in told(tmp_path)["command"]
    facts = json.loads((tmp_path / "run.json").read_text())
    assert Rounds.of_facts(facts, ObjectLibrary.open(("glassware",))).split == "train"


@pytest.mark.slow
def test_rounds_of_two_grippers_of_one_name_are_never_mixed(tmp_path: Path):
    """Neither by going on, nor by comparing; an evaluation from before the hashes goes on."""
    bundled = Path(run.__file__).parents[1] / "grippers" / "panda.json"
    mine = tmp_path / "mine.json"
    mine.write_text(bundled.read_text())
    config = small(tmp_path / "a", rounds=1, gripper=str(mine))
    evaluate(config)
    mine.write_text(bundled.read_text().replace('"closing_force": ', '"closing_force": 1'))
    with pytest.raises(InputError, match=r"run\.json: .* made with gripper_sha256"):
        evaluate(config)
    evaluate(replace(config, out=tmp_path / "b"))
    with pytest.raises(InputError, match="cannot be compared: gripper_sha256"):
        compare(tmp_path / "a", tmp_path / "b")
    facts = json.loads((tmp_path / "a" / "run.json").read_text())
    for key in ("gripper_sha256", "objects_content_sha256"):
        facts.pop(key)
    (tmp_path / "a" / "run.json").write_text(json.dumps(facts))
    evaluate(config)
    compare(tmp_path / "a", tmp_path / "b")


@pytest.mark.slow
def test_a_longer_run_goes_on_from_a_shorter_one(undisturbed: Path, tmp_path: Path):
    evaluate(small(tmp_path, rounds=1))
    evaluate(small(tmp_path))
    assert told(tmp_path) == told(undisturbed) | {"command": told(tmp_path)["command"]}


SCRIPT = """
    from pathlib import Path
    from neugrasp.evaluation.commands import Evaluate
    from neugrasp.evaluation.run import evaluate
    if __name__ == "__main__":
        evaluate({config})
"""


@pytest.mark.slow
def test_killed_at_any_moment_it_goes_on_to_the_same_metrics(undisturbed: Path, tmp_path: Path):
    out, script = tmp_path / "out", tmp_path / "run.py"
    config = re.sub(r"PosixPath\(", "Path(", repr(small(out, workers=2)))
    script.write_text(textwrap.dedent(SCRIPT).replace("{config}", config))
    for seconds in (2.0, 4.0, 6.0):
        process = subprocess.Popen([sys.executable, script], start_new_session=True)
        time.sleep(seconds)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        for path in (out / "rounds").glob("[!.]*.json"):
            read_episode(path)
    evaluate(small(out))
    assert told(out) == told(undisturbed)


@pytest.mark.slow
def test_another_evaluation_is_refused_and_nothing_is_touched(undisturbed: Path):
    before = (undisturbed / "metrics.json").read_bytes()
    for changes, message in (
        ({"seed": 6}, "seed = 5, not 6"),
        ({"protocol": "vgn"}, "protocol = 'paper', not 'vgn'"),
        ({"strategy": "top"}, "strategy = 'random', not 'top'"),
    ):
        with pytest.raises(InputError, match=message):
            evaluate(small(undisturbed, **changes))
    assert (undisturbed / "metrics.json").read_bytes() == before


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"protocol": "mine"}, "choose one of paper, vgn, graspnerf"),
        ({"strategy": "worst"}, "choose one of top, random, highest"),
        ({"views": "orbit"}, "--views 'orbit'"),
        ({"seed": -1}, "--seed -1"),
        ({"workers": 0}, "--workers 0"),
        ({"rounds": 0}, "--rounds 0"),
        ({"detector": "vgn", "weights": "nothing"}, "no weights 'nothing'"),
        ({"detector": "anygrasp"}, "choose one of antipodal, .*neugrasp, .*vgn, or name one as package"),
        ({"detector": "nowhere:SPEC"}, "--detector nowhere:SPEC: cannot be imported"),
        ({"detector": "toy_detector:NONE"}, "--detector toy_detector:NONE: cannot be imported"),
        ({"detector": "toy_detector:Downwards"}, "is a type, not a DetectorSpec"),
        ({"detector": "oracle", "weights": "nowhere"}, "nowhere"),
        ({"depth": "stereo"}, "--depth stereo: antipodal sees no depth"),
        ({"threshold": 1.5}, "--threshold 1.5; it must lie between 0 and 1"),
        ({"samples": 2}, "--samples 2: antipodal sees no photos"),
        ({"samples": 3, "detector": "neugrasp"}, "--samples 3; it must be a power of two"),
    ],
)
def test_options_that_cannot_be_used(changes: dict[str, Any], message: str, tmp_path: Path):
    with pytest.raises(InputError, match=message):
        evaluate(small(tmp_path / "out", **changes))
    assert not (tmp_path / "out").exists()


def test_the_program_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    arguments = ["evaluate", "--out", str(tmp_path), "--detector", "vgn", "--weights", "no.pth"]
    assert cli.main(arguments) == 2
    assert "no.pth: cannot be read" in capsys.readouterr().err


@pytest.mark.slow
def test_a_round_that_crashes_is_reported_and_tried_again(
    undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    real = Rounds.make

    def fragile(self: Rounds, index: int, world: World) -> Round:
        if index == 1:
            raise RuntimeError("the table broke")
        return real(self, index, world)

    with monkeypatch.context() as patch:
        patch.setattr(Rounds, "make", fragile)
        metrics = evaluate(small(tmp_path))
    assert metrics["crashed"] == [1]
    assert metrics["rounds"] == 2
    assert "the table broke" in read_episode(tmp_path / "rounds" / "000001.json").error
    evaluate(small(tmp_path))
    assert told(tmp_path) == told(undisturbed)


@pytest.mark.slow
def test_a_round_does_not_depend_on_those_before_it(undisturbed: Path, tmp_path: Path):
    runner = EpisodeRunner(small(tmp_path), None)
    with runner.world:
        runner.play(0)
        last = runner.play(2)
    assert outcome(last) == outcome(read_episode(undisturbed / "rounds" / "000002.json"))


def outcome(episode: Episode) -> Any:
    untimed = tuple(replace(attempt, timing_s={}) for attempt in episode.attempts)
    return json.loads(json.dumps(vars(replace(episode, attempts=untimed, timing_s={})), default=vars))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["packed", "pile", "single"])
def test_rounds_are_the_same_for_all_materials_and_views(kind: str):
    library = ObjectLibrary.open(("glassware",))
    with World(Workspace(), library) as world:
        rounds = Rounds(kind, 3, library, "diffuse", "released", num_objects=2, image_size=16)
        made = [
            replace(rounds, **changes).make(1, world)
            for changes in (
                {},
                {"materials": "transparent"},
                {"views": "paper"},
                {"seed": 4},
                {"split": "train"},
            )
        ]
        again = rounds.make(1, world)
    plain, glass, paper, other, train = made
    assert again.scene == plain.scene
    assert plain.scene.bodies == glass.scene.bodies == paper.scene.bodies
    assert plain.scene_sha256 == glass.scene_sha256 != other.scene_sha256
    assert plain.scene.materials != glass.scene.materials
    assert {body.name for body in train.scene.bodies} <= {n for _, n in library.choices("train", kind)}
    assert not {body.name for body in train.scene.bodies} & {n for _, n in library.choices("test", kind)}
    for changed in (glass, paper):
        assert (plain.cell.light, plain.cell.table) == (changed.cell.light, changed.cell.table)
    assert len(plain.sensors) == plain.cell.num_inputs == 4
    if kind == "single":
        assert len(plain.scene.bodies) == 1
        assert plain.scene.bodies[0].name == library.choices("test", "single")[1][1]


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A network that knows nothing."""
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("weights") / "random.safetensors"
    save_checkpoint(path, NeuGrasp(tiny().model), {})
    return str(path)


@pytest.mark.slow
def test_the_threshold_is_the_users_or_the_weights_or_the_protocols(tmp_path: Path, weights: str):
    judged = tmp_path / "judged.safetensors"
    save_checkpoint(judged, load_checkpoint(weights).model(), {"threshold": 0.7})
    for changes, threshold in (
        ({"weights": weights}, 0.9),
        ({"weights": str(judged)}, 0.7),
        ({"weights": str(judged), "threshold": 0.3}, 0.3),
    ):
        config = small(tmp_path / "out", detector="oracle", **changes)
        assert detector_spec("oracle").facts(config.options())["threshold"] == threshold
        oracle = detector_spec("oracle").load(config.options())
        assert isinstance(oracle, Oracle)
        assert oracle.threshold == threshold


@pytest.mark.slow
def test_a_detector_of_another_package_plays(tmp_path: Path, photographers: ModuleType):
    config = small(tmp_path / "out", detector="toy_detector:SPEC", rounds=1, seed=31)
    metrics = evaluate(config, photographers.NoiseRenderer)
    assert metrics["detector"] == "toy_detector:SPEC"
    assert metrics["attempts"] >= 1
    assert "--detector toy_detector:SPEC" in config.command()


def test_an_installed_detector_is_known_by_its_name(monkeypatch: pytest.MonkeyPatch):
    point = EntryPoint("downwards", "toy_detector:SPEC", GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: [point] if group == GROUP else [])
    assert detector_spec("downwards").observes == PHOTOS
    with pytest.raises(InputError, match="choose one of downwards"):
        detector_spec("upwards")


@pytest.mark.slow
def test_photos_are_taken_for_the_network_and_backgrounds_once_for_all(
    tmp_path: Path, weights: str, photographers: ModuleType, monkeypatch: pytest.MonkeyPatch
):
    rendered: list[bool] = []

    class Counting(photographers.NoiseRenderer):  # type: ignore[name-defined,misc]
        def render(self, cell: Any, scene: Any, library: Any, camera_indices: Any) -> Any:
            rendered.append(scene is not None)
            return super().render(cell, scene, library, camera_indices)

    monkeypatch.setattr(NeuGraspDetector, "load", classmethod(lambda *_, **__: AirGrasper()))
    config = small(tmp_path / "a", detector="neugrasp", weights=weights, rounds=1)
    metrics = evaluate(config, Counting)
    assert (metrics["attempts"], metrics["successes"]) == (2, 0)
    assert metrics["weights_sha256"] == hashlib.sha256(Path(weights).read_bytes()).hexdigest()
    assert rendered == [False, True, True]
    rendered.clear()
    evaluate(replace(config, out=tmp_path / "b", materials="diffuse"), Counting)
    assert rendered == [True, True]

    rendered.clear()
    other = evaluate(replace(config, out=tmp_path / "c", samples=1), Counting)
    assert rendered == [False, True, True], "photos of other noise need backgrounds of that noise"
    assert (other["samples"], metrics["samples"]) == (1, 4)

    report = InspectEpisode(tmp_path / "a", 0, tmp_path / "report.html", photos="yes")
    page = write_episode_report(report, photographers.NoiseRenderer(1)).read_text()
    assert page.count("data:image/jpeg;base64,") == 4 * 3


@pytest.mark.slow
def test_samples_reach_the_renderer(
    tmp_path: Path, weights: str, photographers: ModuleType, monkeypatch: pytest.MonkeyPatch
):
    asked: list[int] = []

    def renderer(threads: int, settings: RenderSettings) -> object:
        asked.append(settings.samples)
        return photographers.NoiseRenderer(threads)

    monkeypatch.setattr(run, "Renderer", renderer)
    monkeypatch.setattr(NeuGraspDetector, "load", classmethod(lambda *_, **__: AirGrasper()))
    for samples in (4, 1):
        config = small(tmp_path / str(samples), detector="neugrasp", weights=weights, rounds=1, workers=1)
        evaluate(replace(config, samples=samples))
    assert asked == [4, 1]


@pytest.mark.slow
def test_a_story_is_one_file_that_tells_every_attempt(undisturbed: Path, tmp_path: Path):
    page = write_episode_report(InspectEpisode(undisturbed, 1, tmp_path / "report.html")).read_text()
    episode = read_episode(undisturbed / "rounds" / "000001.json")
    assert page.count("<section") == len(episode.attempts) + bool(episode.left and episode.left["bodies"])
    assert f"ended: <b>{episode.ending}</b>" in page
    assert not re.search(r"(src|href)=['\"](?!data:)", page)
    with pytest.raises(InputError, match=r"000009\.json"):
        write_episode_report(InspectEpisode(undisturbed, 9))


def test_a_lab_is_played_with_its_own_hand_and_named_in_what_it_depends_on(tmp_path: Path):
    lab = run.with_domain(small(tmp_path, detector="neugrasp", domain="lab"))
    assert lab.gripper == "robotiq_2f85"
    facts = run.facts_of_rounds(lab)
    assert facts["domain"] == "lab"
    assert not {"domain", "domain_sha256"} & set(run.facts_of_rounds(small(tmp_path, detector="neugrasp")))
    assert run.with_domain(small(tmp_path, detector="neugrasp", domain="lab:lens")).gripper == "panda"
    assert "--domain lab" in lab.command()
    with pytest.raises(InputError, match="--domain lab: has photos; vgn needs depth"):
        evaluate(small(tmp_path / "depth", domain="lab", detector="vgn"))
    with pytest.raises(InputError, match="--domain attic"):
        evaluate(small(tmp_path / "attic", domain="attic"))


@pytest.mark.slow
def test_what_physics_has_tried_holds_when_it_is_carried_out(tmp_path):
    """The perfect judge's grasps succeed, and trying them has moved nothing."""
    config = Evaluate(
        out=tmp_path / "rounds", detector="perfect-judge", scene="packed", rounds=2, seed=5, workers=1
    )
    metrics = evaluate(config)
    assert metrics["attempts"] >= 4
    assert metrics["successes"] == metrics["attempts"]
    runner = EpisodeRunner(config, None)
    runner.robot(runner.round(0), TruthCamera(runner.world))
    before, truth = runner.world.bodies(), TruthCamera(runner.world).capture()
    found = runner.detector.detect(truth)
    assert len(found.grasps) > 0
    assert runner.world.bodies() == before
    runner.world.close()
