"""An evaluation from beginning to end: parallel, resumable, the same metrics whatever the accidents."""

from __future__ import annotations

import hashlib
import json
import logging
import platform
import time
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.detection.registry import DEPTH, detector_spec
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.episode import CRASHED, Episode, attempt_line, read_episode, write_episode
from neugrasp.evaluation.protocols import protocol_of, strategy_of
from neugrasp.evaluation.results_io import FORMAT, VERSION
from neugrasp.evaluation.rounds import num_rounds
from neugrasp.evaluation.scores import scores
from neugrasp.evaluation.tables import metrics_table
from neugrasp.evaluation.workers import MakeSceneRenderer, play_all
from neugrasp.geometry.view_sets import VIEW_SETS
from neugrasp.gripper import Gripper, gripper_hash
from neugrasp.metrics import wilson_interval
from neugrasp.model.compute import Compute
from neugrasp.progress import reached
from neugrasp.robot.cell_file import read_cell, text_hash
from neugrasp.run_folder import CONTENTS, check_run_config, lock_folder, source_commit
from neugrasp.simulation.domain_renderer import domain_renderer
from neugrasp.simulation.infrared import PhotoAndInfrared, infrared_renderer
from neugrasp.simulation.lab import domain_of
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.renderer import Renderer, RenderSettings
from neugrasp.terminal import next_step

log = logging.getLogger(__name__)


def run(config: Evaluate) -> str:
    """`neugrasp evaluate`: the table of the whole, where the numbers are, and what to do next."""
    table = metrics_table(evaluate(config))
    objects = [] if config.objects is None else ["--objects", config.objects]
    then = (
        next_step("failures", config.out, *objects),
        next_step("inspect-episode", config.out, 0, *objects),
    )
    return "\n".join([table, "", str(config.out / "metrics.json"), *then])


def evaluate(config: Evaluate, make_scene_renderer: MakeSceneRenderer | None = None) -> dict[str, Any]:
    """Plays the rounds that `config.out` does not hold yet and returns what metrics.json says of all.

    Rounds that crashed are tried again. Raises `InputError` where an option cannot be used or the folder
    holds another evaluation, `NeuGraspError` where the disk refuses or a worker was killed.
    """
    config = with_cell(with_domain(config))
    facts, wanted = _checked(config)
    with lock_folder(config.out, "evaluate"):
        check_run_config(config.out / "run.json", facts, "evaluation", young=CONTENTS)
        files = [round_file(config.out, index) for index in range(wanted)]
        found = [read_episode(path) for path in files if path.is_file()]
        kept = {episode.index for episode in found if episode.ending != CRASHED}
        missing = [index for index in range(wanted) if index not in kept]
        progress = _Progress(wanted, [e for e in found if e.index in kept])
        reached("rounds", len(kept), wanted)
        with closing(play_all(config, missing, make_scene_renderer or photographer_for(config))) as played:
            for episode in played:
                write_episode(round_file(config.out, episode.index), episode)
                progress.add(episode)
        return _write(config, facts, [read_episode(path) for path in files])


def with_domain(config: Evaluate) -> Evaluate:
    """The evaluation with the gripper of its domain, where it asks for no other. Raises `InputError` where
    there is no such domain, or it has no such depth."""
    domain = domain_of(config.domain)
    if domain.facts() and "depth" in detector_spec(config.detector).observes:
        raise InputError(f"--domain {config.domain}: has photos; {config.detector} needs depth")
    if domain.gripper is None or config.gripper != Evaluate.gripper or config.cell is not None:
        return config
    return replace(config, gripper=domain.gripper)


def with_cell(config: Evaluate) -> Evaluate:
    """The evaluation with the gripper and the views of its cell, where it has one. Raises `InputError` where
    it asks for others, and where nothing of the cell is simulated."""
    if config.cell is None:
        return config
    cell = read_cell(config.cell)
    if not cell.is_twin:
        raise InputError(f"{config.cell}: its arm is real; rounds are played with a twin")
    for option, own in (("gripper", cell.gripper.model), ("views", cell.views)):
        given = getattr(config, option)
        if given not in (own, getattr(Evaluate, option)):
            raise InputError(f"--{option} {given}: the cell file says {own}")
    return replace(config, gripper=cell.gripper.model, views=cell.views)


def facts_of_rounds(config: Evaluate) -> dict[str, Any]:
    """What the rounds of an evaluation depend on. Raises `InputError` where an option cannot be used."""
    return _checked(config)[0]


def round_file(out: Path, index: int) -> Path:
    """Where the record of a round is."""
    return out / "rounds" / f"{index:06d}.json"


def photographer_for(config: Evaluate) -> MakeSceneRenderer:
    """What renders for the detector of an evaluation."""
    settings, domain = RenderSettings(samples=config.samples), domain_of(config.domain)
    if domain.facts():
        return partial(domain_renderer, domain, settings)
    if config.depth != "stereo":
        return partial(Renderer, settings=settings)
    only_depth = detector_spec(config.detector).observes == DEPTH
    return infrared_renderer if only_depth else partial(PhotoAndInfrared, settings=settings)


def _checked(config: Evaluate) -> tuple[dict[str, Any], int]:
    """What the rounds depend on, and how many are wanted."""
    rules = protocol_of(config.protocol)
    strategy = rules.strategy if config.strategy == "protocol" else config.strategy
    strategy_of(strategy)
    if config.views not in VIEW_SETS:
        raise InputError(f"--views {config.views!r}; choose one of {', '.join(VIEW_SETS)}")
    if config.seed < 0:
        raise InputError(f"--seed {config.seed}; it must be at least 0")
    if config.workers is not None and config.workers < 1:
        raise InputError(f"--workers {config.workers}; it must be at least 1")
    if config.threshold is not None and not 0 <= config.threshold <= 1:
        raise InputError(f"--threshold {config.threshold}; it must lie between 0 and 1")
    spec = detector_spec(config.detector)
    if config.depth != "exact" and "depth" not in spec.observes:
        raise InputError(f"--depth {config.depth}: {config.detector} sees no depth")
    if config.samples != Evaluate.samples and "image" not in spec.observes:
        raise InputError(f"--samples {config.samples}: {config.detector} sees no photos")
    Compute.of(config.device, config.precision)
    RenderSettings(samples=config.samples)  # refuses what is no power of two
    library = ObjectLibrary.open(config.object_sets, config.objects)
    choices = library.choices(config.split, config.scene)
    facts = {
        "detector": config.detector,
        "scene": config.scene,
        "materials": config.materials,
        "strategy": strategy,
        "protocol": config.protocol,
        "views": config.views,
        "depth": config.depth if "depth" in spec.observes else None,
        **({"samples": config.samples} if "image" in spec.observes else {}),
        "gripper": Gripper.load(config.gripper).name,
        "gripper_sha256": gripper_hash(config.gripper),
        "seed": config.seed,
        "split": config.split,
        "object_sets": list(config.object_sets),
        "objects_sha256": hashlib.sha256(json.dumps(choices).encode()).hexdigest(),
        "objects_content_sha256": library.content_hash(choices),
        **spec.facts(config.options()),
        **domain_of(config.domain).facts(),
        **({"cell_sha256": text_hash(config.cell)} if config.cell is not None else {}),
        # Only where it is not the usual one: evaluations of before it was an option go on.
        **({"precision": config.precision} if config.precision != "float32" else {}),
        **({"after_failure": config.after_failure} if config.after_failure != "anywhere" else {}),
    }
    return facts, num_rounds(config.scene, choices, config.rounds)


@dataclass
class _Progress:
    """What is done, how well and how fast."""

    total: int
    episodes: list[Episode]
    start: float = field(default_factory=time.monotonic)
    played: int = 0

    def add(self, episode: Episode) -> None:
        """Counts a round that was just played."""
        self.episodes.append(episode)
        self.played += 1
        attempts = [attempt for episode in self.episodes for attempt in episode.attempts]
        successes = sum(attempt.success for attempt in attempts)
        low, high = (100 * edge for edge in wilson_interval(successes, len(attempts)))
        rate = self.played / (time.monotonic() - self.start)
        reached("rounds", len(self.episodes), self.total)
        log.info(
            "%d of %d rounds, SR %.1f %% (%.1f to %.1f), %.0f rounds an hour, %.0f min left",
            len(self.episodes),
            self.total,
            100 * successes / max(len(attempts), 1),
            low,
            high,
            3600 * rate,
            (self.total - len(self.episodes)) / rate / 60,
        )


def _write(config: Evaluate, facts: dict[str, Any], episodes: list[Episode]) -> dict[str, Any]:
    """Writes attempts.jsonl and metrics.json, in the order of the rounds."""
    crashed = [episode for episode in episodes if episode.ending == CRASHED]
    for episode in crashed:
        log.warning("round %d crashed and counts nowhere: %s", episode.index, episode.error)
    lines = [attempt_line(attempt) for episode in episodes for attempt in episode.attempts]
    scenes = json.dumps([episode.scene_sha256 for episode in episodes])
    metrics = {
        "format": FORMAT,
        "version": VERSION,
        **facts,
        **scores(episodes, protocol_of(config.protocol)),
        "rounds_sha256": hashlib.sha256(scenes.encode()).hexdigest(),
        "command": config.command(),
        "commit": source_commit(),
        "machine": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
    }
    with whole_or_nothing(config.out, ("metrics.json", "attempts.jsonl")) as part:
        (part / "attempts.jsonl").write_text("".join(lines), encoding="utf-8")
        (part / "metrics.json").write_text(
            json.dumps(metrics, indent=1, allow_nan=False) + "\n", encoding="utf-8"
        )
    return metrics
