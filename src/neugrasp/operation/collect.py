"""`neugrasp collect`: a data folder of one cell, from photos and from what came of the model's own picks."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.captures import write_capture
from neugrasp.data.labels import LABELS_FILE, labels_from_bytes
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import detector_spec, photo_detector
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.run import facts_of_rounds, photographer_for, with_cell, with_domain
from neugrasp.evaluation.workers import MakeSceneRenderer, one_thread
from neugrasp.execution import MIN_OPENING
from neugrasp.geometry.pose import Array, rigid, rotation_about
from neugrasp.grasp import Grasp, Grasps
from neugrasp.observation import Views
from neugrasp.operation.collection_scenes import CellScenes, Scenes, simulated_scenes
from neugrasp.operation.command import Collect
from neugrasp.operation.guiding import Guide, lead_through
from neugrasp.operation.hardware import empty_folder, opened
from neugrasp.operation.person import Person
from neugrasp.operation.run import checked_cell
from neugrasp.operation.tried import Tried, labels_of
from neugrasp.progress import reached
from neugrasp.robot.cell_file import CellFile, text_hash
from neugrasp.robot.errors import NoPlan, Refused
from neugrasp.robot.interface import Robot
from neugrasp.robot.pick import pick
from neugrasp.robot.wrist_camera import Photographs, read_empty
from neugrasp.run_folder import check_run_config, lock_folder
from neugrasp.terminal import next_step
from neugrasp.training.prepared import FEWEST_IN_GROUPS

log = logging.getLogger(__name__)

ASIDE, TURN = 0.012, np.pi / 4
"""Metres along each axis, and radians about the approach, by which a grasp lies beside a pick, at most."""


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

    Raises `InputError` where an option cannot be used, or the folder holds another set, and a `RobotError`
    where an arm has a fault or a person ends it; what was done until then is kept.
    """
    if min(config.scenes, config.grasps) < 1:
        raise InputError("--scenes and --grasps must be at least 1")
    photo_detector(config.detector, "a collection")
    cell = None if config.cell is None else checked_cell(config.cell, config.speed)
    is_real = cell is not None and not cell.is_twin
    if config.by_hand and not is_real:
        raise InputError("--by-hand: a person leads an arm; give the file of a real cell as --cell")
    asked = [] if is_real else [_rounds(config, kind) for kind in _kinds(config)]
    folders = [config.out / "scenes" / f"{number:06d}" for number in range(config.scenes)]
    with lock_folder(config.out, "collect"):
        facts = (
            _facts(config, cell)
            if cell is not None and is_real
            else {"kinds": [facts_of_rounds(one) for one in asked]}
        )
        check_run_config(config.out / "collection.json", {"grasps": config.grasps, **facts}, "collection")
        missing = [number for number, f in enumerate(folders) if not (f / LABELS_FILE).is_file()]
        reached("scenes", len(folders) - len(missing), len(folders))
        if missing and cell is not None and is_real:
            _collect_real(config, cell, {number: folders[number] for number in missing})
        elif missing:
            make = make_scene_renderer or photographer_for(asked[0])
            with one_thread(), simulated_scenes(asked, make) as scenes:
                for number in missing:
                    _collect_one(scenes, number, folders[number], config)
    return folders


def _collect_real(config: Collect, cell: CellFile, folders: Mapping[int, Path]) -> None:
    """The model's picks, or those of a person, on a real table."""
    person = Person("a person has to lay objects and to answer: run this in a terminal")
    empty = read_empty(empty_folder(cell), cell.camera)
    detector = None if config.by_hand else detector_spec(config.detector).load(_options(config, cell))
    with opened(cell) as hardware:
        if detector is None:
            lead_through(folders, Guide(cell, hardware, Photographs(hardware.camera, empty), person))
            return
        scenes = CellScenes(hardware, empty, detector, person)
        for number, folder in folders.items():
            _collect_one(scenes, number, folder, config)


def _facts(config: Collect, cell: CellFile) -> dict[str, Any]:
    """What a set of a real cell depends on."""
    assert config.cell is not None
    file = {"cell_sha256": text_hash(config.cell)}
    if config.by_hand:
        return {**file, "by_hand": True}
    of_detector = detector_spec(config.detector).facts(_options(config, cell))
    return {**file, "detector": config.detector, **of_detector}


def _options(config: Collect, cell: CellFile) -> DetectorOptions:
    return DetectorOptions(
        weights=config.weights,
        threshold=config.threshold,
        hand_check=config.hand_check,
        gripper=cell.gripper.model,
        seed=config.seed,
        device=config.device,
    )


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
        hand_check=config.hand_check,
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
    robot, views = _seen(scenes, number)
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


def _seen(scenes: Scenes, number: int) -> tuple[Robot[Views] | None, Views]:
    """The robot before a scene in which something lies, and the photos."""
    while True:
        robot = scenes.lay(number)
        views = robot.camera.capture()
        if robot.table.count():
            return robot, views


def wanted(picks: Grasps, most: int, rng: np.random.Generator) -> list[Grasp]:
    """So many of the picks: the best ones and others, drawn by chance, in turns, so that both outcomes are
    seen. Where there are fewer picks, picks moved and turned by chance, too."""
    if not len(picks):
        return []
    best, drawn = np.argsort(-picks.scores, kind="stable"), rng.permutation(len(picks))
    pairs = zip(*((best, drawn) if rng.random() < 0.5 else (drawn, best)), strict=True)
    order = list(dict.fromkeys(int(index) for pair in pairs for index in pair))
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
