"""What several detectors see in the same scenes: their surfaces side by side, with their best grasps."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image as Picture

from neugrasp.detection.contract import Detection
from neugrasp.errors import NeuGraspError
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.episode_runner import EpisodeRunner
from neugrasp.evaluation.run import photographer_for
from neugrasp.evaluation.workers import MakeSceneRenderer, open_runner
from neugrasp.grasp import Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Image, Observation
from neugrasp.output import whole_file
from neugrasp.pictures import Tile, contact_sheet, detection_picture, free_where_unseen, write_picture
from neugrasp.progress import counted
from neugrasp.robot.simulated_cameras import Truth, TruthCamera

log = logging.getLogger(__name__)

SCENES = 2
"""The first rounds."""
EDGE = 320
"""Pixels of a tile."""


def write_surfaces(
    path: Path, evaluations: Sequence[Evaluate], make_scene_renderer: MakeSceneRenderer | None = None
) -> None:
    """One row for each of the first rounds: a photo, the true surface, and that of each detector."""
    columns = [
        _column(each, make_scene_renderer, with_truth=not index)
        for index, each in enumerate(counted(evaluations, "detectors"))
    ]
    rows = [[tile for column in columns for tile in column[scene]] for scene in range(SCENES)]
    widest = max(map(len, rows))
    sheet = contact_sheet([tile for row in rows for tile in row], columns=widest)
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as part:
        write_picture(part, sheet)


def _column(
    config: Evaluate, make_scene_renderer: MakeSceneRenderer | None, with_truth: bool
) -> list[list[Tile]]:
    """The tiles of a detector, scene by scene; those that all share come with the first."""
    make = make_scene_renderer or photographer_for(config)
    with open_runner(replace(config, workers=1), make, 1) as runner:
        found = []
        for index in range(SCENES):
            seen, tiles = runner.capture(index), []
            if with_truth:
                truth = TruthCamera(runner.world).capture()
                tiles = [Tile(_sized(_photo(seen)), f"round {index}"), Tile(_true(runner, truth), "truth")]
            found.append([*tiles, Tile(_seen_by(runner, seen), config.detector)])
        return found


def _seen_by(runner: EpisodeRunner, seen: Observation) -> Image:
    try:
        return _surface(runner.detector.detect(seen))
    except NeuGraspError as error:
        log.warning("%s: %s", runner.config.detector, error)
        return np.full((EDGE, EDGE, 3), 255, np.uint8)


def _surface(found: Detection) -> Image:
    grid = free_where_unseen(found.grid())
    shown = detection_picture(grid, found.workspace, found.grasps, found.gripper)
    return _sized(shown)


def _true(runner: EpisodeRunner, truth: Truth) -> Image:
    gripper = Gripper.load(runner.config.gripper)
    return _surface(Detection(Grasps.of(()), truth.workspace, gripper, truth.tsdf.values))


def _photo(seen: Observation) -> Image:
    image = seen.frames[0].image
    return np.zeros((EDGE, EDGE, 3), np.uint8) if image is None else image


def _sized(image: Image) -> Image:
    return np.asarray(Picture.fromarray(image).resize((EDGE, EDGE), Picture.Resampling.BOX))
