"""`neugrasp run`: a cell clears its table. The loop is that of the benchmark; so is what is written."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.detection.registry import detector_spec
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.declutter import EpisodeConfig, Log, declutter
from neugrasp.evaluation.episode import EMPTY, UNFINISHED, Attempt, Episode, read_episode, write_episode
from neugrasp.evaluation.protocols import ELSEWHERE, PROTOCOLS, strategy_of
from neugrasp.evaluation.run import facts_of_rounds, photographer_for, round_file, with_cell
from neugrasp.evaluation.workers import open_runner
from neugrasp.geometry.pose import Array
from neugrasp.operation.check import findings_of
from neugrasp.operation.command import Run
from neugrasp.operation.confirm import Confirming
from neugrasp.operation.dry_run import rehearsed_with_photos, written
from neugrasp.operation.hardware import empty_folder, opened
from neugrasp.operation.seen_table import NoGroundTruth, SeenTable
from neugrasp.robot.attended import Attendant
from neugrasp.robot.cell_file import CellFile, read_cell, text_hash
from neugrasp.robot.errors import RobotError
from neugrasp.robot.interface import Robot
from neugrasp.robot.workcell import planner_of
from neugrasp.robot.wrist_camera import Photographs, read_empty
from neugrasp.run_folder import check_run_config, lock_folder
from neugrasp.terminal import next_step
from neugrasp.viewer.live import LivePage

log = logging.getLogger(__name__)

ROUND = 0
"""A run is one round."""
THREADS = 2
"""That render the photos of a twin."""


def run(config: Run) -> str:
    """`neugrasp run`: what came of it, and what to do next."""
    if config.max_failures < 1:
        raise InputError(f"--max-failures {config.max_failures}; it must be at least 1")
    cell = checked_cell(config.cell, config.speed)
    if config.dry_run:
        if config.confirm or config.view:
            raise InputError("--dry-run moves nothing: there is nothing to --confirm or --view")
        return _dry_run(config, cell)
    if config.photos is not None:
        raise InputError("--photos is for --dry-run: an arm that moves takes its own")
    file = round_file(config.out, ROUND)
    with lock_folder(config.out, "run"):
        facts = facts_of_rounds(evaluation_of(config, cell)) if cell.is_twin else _facts(config)
        check_run_config(config.out / "run.json", facts, "run")
        begun = read_episode(file) if file.is_file() else None
        if begun is None or begun.ending == UNFINISHED:
            clear = _clear_twin if cell.is_twin else _clear_table
            with _watched(config, cell, _Told(file, begun)) as watch:
                episode = clear(config, cell, watch)
            write_episode(file, episode)
        else:
            log.info("%s: this run has ended; another --out begins a new one", config.out)
            episode = begun
    return "\n".join([*_summary(episode), *_next(config)])


def checked_cell(file: Path, speed: float) -> CellFile:
    """The cell at a share of its speed. Raises `InputError` where something is wrong with either."""
    if not 0 < speed <= 1:
        raise InputError(f"--speed {speed}; it must be above 0, and at most 1")
    cell = read_cell(file)
    wrong = [str(finding).strip() for finding in findings_of(cell) if finding.problem]
    if wrong:
        raise InputError(f"{file}: {wrong[0]}; neugrasp cell check {file} says everything")
    return cell.at_speed(speed)


def _facts(config: Run) -> dict[str, Any]:
    """What a run with hardware depends on."""
    spec = detector_spec(config.detector)
    if "image" not in spec.observes or "depth" in spec.observes:
        raise InputError(f"--detector {config.detector}: a cell has photos, and nothing else")
    return {
        "cell_sha256": text_hash(config.cell),
        "detector": config.detector,
        "strategy": config.strategy,
        **spec.facts(config.options()),
    }


def evaluation_of(config: Run, cell: CellFile) -> Evaluate:
    """The rounds of which a run in a twin is one."""
    assert cell.twin is not None
    asked = Evaluate(
        out=config.out,
        detector=config.detector,
        scene=cell.twin.scene,
        materials=cell.twin.materials,
        seed=cell.twin.seed,
        strategy=config.strategy,
        after_failure=ELSEWHERE,
        rounds=1,
        weights=config.weights,
        evaluator=config.evaluator,
        hand_check=config.hand_check,
        threshold=config.threshold,
        samples=config.samples,
        device=config.device,
        precision=config.precision,
        cell=config.cell,
        workers=1,
    )
    return with_cell(asked)


@dataclass
class _Told:
    """Writes the record after every pick, and says what came of it."""

    file: Path
    begun: Episode | None

    def __call__(self, episode: Episode) -> None:
        write_episode(self.file, episode)
        log.info("%s", _pick(episode.attempts[-1]))


@dataclass(frozen=True)
class _Watch:
    """Who is told of a run, and where it is written."""

    file: Path
    log: Log
    attendants: tuple[Attendant, ...]


@contextmanager
def _watched(config: Run, cell: CellFile, told: _Told) -> Iterator[_Watch]:
    """A person at the terminal and a page in the browser, where they were asked for."""
    person = (Confirming(planner_of(cell)),) if config.confirm else ()
    if not config.view:
        yield _Watch(told.file, Log(told.begun, told), person)
        return
    with LivePage(
        f"neugrasp run {config.cell.name}", cell.workspace, cell.gripper.gripper, config.host, config.port
    ) as page:
        log.info("open %s in a browser; its button stops the arm", page.url)

        def tell(episode: Episode) -> None:
            told(episode)
            page.told(episode)

        yield _Watch(told.file, Log(told.begun, tell, page.stage), (page, *person))


def _dry_run(config: Run, cell: CellFile) -> str:
    """What a round would do."""
    if cell.is_twin:
        if config.photos is not None:
            raise InputError("--photos is for hardware: a twin photographs its own table")
        asked = evaluation_of(config, cell)
        rules = replace(PROTOCOLS["paper"], num_objects=_objects(cell))
        with open_runner(asked, photographer_for(asked), THREADS, rules=rules, speed=config.speed) as runner:
            rehearsal = runner.rehearse(ROUND)
    else:
        _facts(config)
        detector = detector_spec(config.detector).load(replace(config.options(), gripper=cell.gripper.model))
        rehearsal = rehearsed_with_photos(cell, config.photos, detector, strategy_of(config.strategy))
    return written(rehearsal, cell, config.out)


def _objects(cell: CellFile) -> int:
    assert cell.twin is not None
    return cell.twin.objects


def _clear_table(config: Run, cell: CellFile, watch: _Watch) -> Episode:
    """A real table, to its end."""
    detector = detector_spec(config.detector).load(replace(config.options(), gripper=cell.gripper.model))
    up: Array = cell.workspace.world_from_workspace[:3, 2]
    rules = replace(PROTOCOLS["paper"], max_failures=config.max_failures, after_failure=ELSEWHERE)
    game = EpisodeConfig(rules, strategy_of(config.strategy), lambda i, j: np.random.default_rng([i, j]), up)
    empty = read_empty(empty_folder(cell), cell.camera)
    with opened(cell, watch.attendants) as hardware:
        table = SeenTable(Photographs(hardware.camera, empty))
        robot = Robot(table, hardware.manipulator, table)
        with _saying_where(watch.file):
            return declutter(game, ROUND, robot, detector, NoGroundTruth(), watch.log)


@contextmanager
def _saying_where(file: Path) -> Iterator[None]:
    """A fault of the cell also says where the record is, and that it goes on."""
    try:
        yield
    except RobotError as error:
        raise type(error)(f"{error}; {file} holds what was done, the same command goes on") from error


def _clear_twin(config: Run, cell: CellFile, watch: _Watch) -> Episode:
    """The table of a twin, to its end. Raises a `RobotError` where the arm was stopped; what was done until
    then is written."""
    asked = evaluation_of(config, cell)
    rules = replace(PROTOCOLS["paper"], max_failures=config.max_failures, num_objects=_objects(cell))
    with open_runner(asked, photographer_for(asked), THREADS, rules=rules, speed=config.speed) as runner:
        if watch.log.begun is not None:
            log.info("going on after %d picks", len(watch.log.begun.attempts))
        with _saying_where(watch.file):
            return runner.play_on(ROUND, watch.log, watch.attendants)


def _pick(attempt: Attempt) -> str:
    """One pick in a line."""
    passed = ", ".join(f"{count} {reason}" for reason, count in attempt.skipped.items())
    seconds = attempt.timing_s
    return (
        f"pick {attempt.attempt + 1}: {attempt.reason}, score {attempt.score:.2f}, "
        f"{attempt.candidates} grasps"
        + (f", passed over: {passed}" if passed else "")
        + f"; {attempt.objects - attempt.success - attempt.lost} objects left; look "
        f"{seconds.get('look', 0):.1f} s, detect {seconds.get('detect', 0):.1f} s, "
        f"plan {seconds.get('plan', 0):.1f} s, pick {seconds.get('execute', 0):.1f} s"
    )


def _summary(episode: Episode) -> Sequence[str]:
    passed = ", ".join(f"{count} {reason}" for reason, count in episode.skipped.items()) or "none"
    ending = "the table is empty" if episode.ending == EMPTY else f"stopped: {episode.ending}"
    return (
        f"{ending}; {episode.successes} of {episode.objects} objects with {len(episode.attempts)} picks",
        f"grasps passed over: {passed}",
    )


def _next(config: Run) -> Sequence[str]:
    return (
        next_step("inspect-episode", config.out, ROUND, "--photos", "no"),
        next_step("view", config.out, "--round", ROUND),
    )
