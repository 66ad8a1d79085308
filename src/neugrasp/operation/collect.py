"""`neugrasp collect`: a data folder of one cell, from photos and from what came of the model's own picks."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from neugrasp.data.captures import write_capture
from neugrasp.data.labels import LABELS_FILE, labels_from_bytes
from neugrasp.detection.contract import Detector
from neugrasp.detection.registry import photo_detector
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.episode_runner import EpisodeRunner
from neugrasp.evaluation.run import facts_of_rounds, photographer_for, with_cell, with_domain
from neugrasp.evaluation.workers import MakeSceneRenderer, one_thread
from neugrasp.execution import MIN_OPENING
from neugrasp.geometry.pose import Array, rigid, rotation_about
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Views
from neugrasp.operation.command import Collect
from neugrasp.operation.tried import Tried, labels_of
from neugrasp.progress import reached
from neugrasp.robot.errors import NoPlan, Refused
from neugrasp.robot.interface import Robot
from neugrasp.robot.pick import pick
from neugrasp.robot.simulated_cameras import TruthCamera
from neugrasp.run_folder import check_run_config, lock_folder
from neugrasp.terminal import next_step
from neugrasp.training.prepared import FEWEST_IN_GROUPS

log = logging.getLogger(__name__)

THREADS = 2
"""That render the photos."""
ASIDE, TURN = 0.012, np.pi / 4
"""Metres along each axis, and radians about the approach, by which a grasp lies beside a pick, at most."""


class Scenes(Protocol):
    """Where scenes are laid, looked at and grasped in."""

    @property
    def gripper(self) -> Gripper:
        """The hand that tries."""
        ...

    @property
    def detector(self) -> Detector[Views]:
        """Whose picks are tried."""
        ...

    def lay(self, number: int) -> Robot[Views]:
        """The robot before scene `number`."""
        ...

    def again(self) -> Robot[Views] | None:
        """The robot before the same scene, as it was photographed; None where it is no more."""
        ...


def run(config: Collect) -> str:
    """`neugrasp collect`: what there is now, and what to do next."""
    folders = collect(config)
    labels = [labels_from_bytes((f / LABELS_FILE).read_bytes(), str(f)) for f in folders]
    tried, held_fast = (sum(int(count(one.success)) for one in labels) for count in (len, np.sum))
    then = next_step(
        "train", "--recipe", "adapt", "--init", config.weights, "--data", config.out, "--out", "runs/adapted"
    )
    return f"{len(folders)} scenes in {config.out}, {tried} grasps tried, {held_fast} held\n{then}"


def collect(config: Collect, make_scene_renderer: MakeSceneRenderer | None = None) -> list[Path]:
    """Makes the scenes that `config.out` does not hold yet; the folders of all, in order.

    Raises `InputError` where an option cannot be used, or the folder holds another set.
    """
    if min(config.scenes, config.grasps) < 1:
        raise InputError("--scenes and --grasps must be at least 1")
    photo_detector(config.detector, "a collection")
    asked = [_rounds(config, kind) for kind in _kinds(config)]
    facts = {"grasps": config.grasps, "kinds": [facts_of_rounds(one) for one in asked]}
    folders = [config.out / "scenes" / f"{number:06d}" for number in range(config.scenes)]
    with lock_folder(config.out, "collect"):
        check_run_config(config.out / "collection.json", facts, "collection")
        missing = [number for number, f in enumerate(folders) if not (f / LABELS_FILE).is_file()]
        reached("scenes", len(folders) - len(missing), len(folders))
        if missing:
            make = make_scene_renderer or photographer_for(asked[0])
            with one_thread(), _simulated(asked, make) as scenes:
                for number in missing:
                    _collect_one(scenes, number, folders[number], config)
    return folders


def _kinds(config: Collect) -> Sequence[Any]:
    return ("pile", "packed") if config.scene == "both" else (config.scene,)


def _rounds(config: Collect, kind: Any) -> Evaluate:
    """The rounds whose beginnings are the scenes: objects of training, so that the test has others."""
    asked = Evaluate(
        out=config.out,
        detector=config.detector,
        scene=kind,
        materials=config.materials,
        domain=config.domain,
        views="groups8" if config.cell is None else Evaluate.views,
        weights=config.weights,
        threshold=config.threshold,
        samples=config.samples,
        cell=config.cell,
        split="train",
        seed=config.seed,
        device=config.device,
    )
    return with_cell(with_domain(asked))


def _collect_one(scenes: Scenes, number: int, folder: Path, config: Collect) -> None:
    """Looks at a scene, tries grasps in it, and writes both."""
    rng = np.random.default_rng([config.seed, number])
    robot: Robot[Views] | None = scenes.lay(number)
    assert robot is not None
    views = robot.camera.capture()
    up: Array = views.workspace.world_from_workspace[:3, 2]
    detection = scenes.detector.detect(seen_first(views))
    tried: list[Tried] = []
    for grasp in wanted(detection.grasps, config.grasps, rng):
        if robot is None:
            break
        try:
            hand = robot.manipulator.prepare(grasp, detection)
        except (NoPlan, Refused) as reason:
            log.debug("scene %d: %s", number, reason)
            continue
        least = MIN_OPENING["paper"] * robot.manipulator.max_opening
        result = pick(robot.manipulator, hand, grasp, least, up)
        tried.append(Tried(grasp, result.success, result.opening))
        robot = scenes.again()
    write_capture(folder, views, labels_of(tried, views.workspace, scenes.gripper))
    held_fast = sum(one.success for one in tried)
    reached("scenes", number + 1, config.scenes)
    log.info(
        "scene %d: %d grasps found, %d tried, %d held", number, len(detection.grasps), len(tried), held_fast
    )


def wanted(picks: Grasps, most: int, rng: np.random.Generator) -> list[Grasp]:
    """So many of the picks, drawn by chance; where these are fewer, picks moved and turned by chance, too."""
    if not len(picks):
        return []
    order = rng.permutation(len(picks)).tolist()
    rounds = [[picks[i] for i in order]]
    while len(rounds) * len(picks) < most:
        rounds.append([_beside(picks[i], rng) for i in order])
    return [grasp for one in rounds for grasp in one][:most]


def _beside(grasp: Grasp, rng: np.random.Generator) -> Grasp:
    """A grasp near another one: whoever knows where it fails knows where it holds."""
    turn = rotation_about((0, 0, 1), rng.uniform(-TURN, TURN))
    return replace(grasp, pose=grasp.pose @ rigid(turn, rng.uniform(-ASIDE, ASIDE, 3)))


def seen_first(views: Views) -> Views:
    """What the detector sees: the first of the two groups that training makes of many views."""
    count = len(views)
    return replace(views, frames=views.frames[: (count + 1) // 2]) if count >= FEWEST_IN_GROUPS else views


class SimulatedScenes:
    """The beginnings of rounds, as often as they are wanted."""

    def __init__(self, runners: Sequence[EpisodeRunner]):
        self._runners = runners
        self._at = runners[0], runners[0].round(0)

    @property
    def gripper(self) -> Gripper:
        """The hand that tries."""
        return self._runners[0].world.gripper

    @property
    def detector(self) -> Detector[Views]:
        """Whose picks are tried."""
        return self._runners[0].detector

    def lay(self, number: int) -> Robot[Views]:
        """As `Scenes.lay`; the runners take turns."""
        runner = self._runners[number % len(self._runners)]
        self._at = runner, runner.round(number)
        return self.again()

    def again(self) -> Robot[Views]:
        """As `Scenes.again`."""
        runner, fixed = self._at
        return runner.robot(fixed, TruthCamera(runner.world))[0]


@contextmanager
def _simulated(asked: Sequence[Evaluate], make: MakeSceneRenderer) -> Iterator[SimulatedScenes]:
    with ExitStack() as closing:
        scene_renderer = closing.enter_context(make(THREADS))
        runners = [EpisodeRunner(one, scene_renderer) for one in asked]
        for runner in runners:
            closing.enter_context(runner.world)
        yield SimulatedScenes(runners)
