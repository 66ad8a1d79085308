"""Grasps tried for the evaluator of grasps: poses that a detector might choose, and what came of them.

    python benchmarks/evaluator_lessons.py OUT --scene pile --objects DIR [--num 100] [--seed 1000]
    python benchmarks/evaluator_lessons.py OUT --photos DATA --objects DIR [--weights neugrasp]

The first makes scenes without photos and clears them object by object; in every state grasps drawn from
the true surface are tried. The second takes the scenes of `neugrasp generate`: what the weights make of the
photos is one surface, the true one another; grasps are drawn from each and shown on it alone.
With `--evaluator FILE` half of the poses are those that this evaluator likes best: its errors become lessons.
One object in ten weighs more than 1 kg: with `--heavy 9` it is every second, for what is too heavy to hold.

One file NAME.npz (`data/lessons.py`) for a scene. Scenes that are there are left alone, so a run that was
stopped goes on where it was. Around the grasps that held, or slipped, others are tried: there the line lies.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from over_records import sets_of, tell

from neugrasp.data.lessons import ABOUT, Lesson, about_lessons, joined, write_lesson
from neugrasp.data.records import read_record
from neugrasp.detection.candidates import Candidates
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.detection.judge import Judge, JudgeConfig
from neugrasp.errors import NeuGraspError
from neugrasp.execution import AT_PREGRASP, NOTHING_HELD, ON_APPROACH, SLIPPED, SUCCESS
from neugrasp.geometry.pose import Array, to_quaternion
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.model.grasp_evaluator import FineGrid
from neugrasp.output import whole_file
from neugrasp.run_folder import check_run_config
from neugrasp.simulation.arrange import arrange
from neugrasp.simulation.batched_trials import execute_each
from neugrasp.simulation.grasp_execution import Trial
from neugrasp.simulation.gt_tsdf import scan
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World

MOST_AROUND = 20
HEAVY = 1.0
"""Kilograms."""
Propose = Callable[[np.ndarray, np.random.Generator], Array]
"""From a grid to poses to try."""
UNSURE = (0.2, 0.9)
LIKED = JudgeConfig(threshold=0.2, most=40)
"""How an evaluator's favourites are sought: down to those that a detector would not tell."""


@dataclass(frozen=True)
class Proposals:
    """Poses to try: drawn by chance, or half of them such as an evaluator likes, or is unsure of."""

    candidates: Candidates
    count: int
    judge: Judge | None = None

    def __call__(self, grid: np.ndarray, rng: np.random.Generator) -> Array:
        """Poses for a grid (r, r, r)."""
        workspace = Workspace()
        if self.judge is None:
            return self.candidates.draw(grid, workspace, rng, self.count)
        drawn = self.candidates.draw(grid, workspace, rng, 1000)
        told = [grasp.pose for grasp in self.judge.find(grid, workspace).grasps]
        fine = FineGrid.of(torch.from_numpy(np.asarray(grid, np.float32)), workspace)
        said = self.judge.probabilities(fine, workspace, drawn)
        unsure = rng.permutation(np.flatnonzero((said > UNSURE[0]) & (said < UNSURE[1])))
        liked = np.array(told).reshape(-1, 4, 4)
        return np.concatenate([liked, drawn[unsure[: self.count // 4]], drawn[: self.count // 2]])


def tried(world: World, grid: np.ndarray, poses: Array) -> tuple[Lesson, list[Trial]]:
    """What came of poses (k, 4, 4)."""
    outcomes = execute_each(world, poses)
    reasons = np.array([outcome.reason for outcome in outcomes])
    free = (reasons != AT_PREGRASP) & (reasons != ON_APPROACH)
    return Lesson(
        grid[None].astype(np.float16),
        poses[:, :3, 3].astype(np.float32),
        np.array([to_quaternion(pose) for pose in poses], np.float32).reshape(-1, 4),
        reasons == SUCCESS,
        free,
        np.zeros(len(poses), np.uint8),
    ), outcomes


def explored(
    world: World, grid: np.ndarray, poses: Array, candidates: Candidates, rng: np.random.Generator, each: int
) -> tuple[list[Lesson], list[Trial]]:
    """Poses and others around those that closed on something."""
    if not len(poses):
        return [], []
    lesson, outcomes = tried(world, grid, poses)
    close = [k for k, one in enumerate(outcomes) if one.reason in (SUCCESS, SLIPPED, NOTHING_HELD)]
    chosen = rng.permutation(close)[:MOST_AROUND].astype(np.int64)
    near = candidates.around(poses[chosen], rng, each)
    near = near[candidates.comes_through(grid, world.workspace, near)]
    more, _ = tried(world, grid, near) if len(near) else (lesson, [])
    return ([lesson, more] if len(near) else [lesson]), outcomes


def lessons_of(world: World, rng: np.random.Generator, propose: Propose, each: int) -> Lesson | None:
    """All states of the settled scene in `world`, one body less in each: the one that was held most often."""
    candidates, found = Candidates(world.gripper), []
    while world.bodies():
        grid = scan(world, world.workspace).values
        lessons, outcomes = explored(world, grid, propose(grid, rng), candidates, rng, each)
        found += lessons
        held = Counter(outcome.body for outcome in outcomes if outcome.body is not None)
        count = len(world.bodies())
        world.remove(held.most_common(1)[0][0] if held else int(rng.integers(count)))
        world.settle()
    return joined(found) if found else None


@dataclass(frozen=True)
class Maker:
    """Makes the lessons of one scene after another."""

    world: World
    propose: Proposals
    each: int
    predicted_only: bool = False

    def of_truth(self, kind: str, choices: list[tuple[str, str]], rng: np.random.Generator) -> Lesson | None:
        """A new scene, cleared object by object."""
        seed = int(rng.integers(2**31))
        scene = arrange(kind, seed, self.world, choices, int(rng.integers(2, 7)))
        self.world.reset(replace(scene, materials=()))
        return lessons_of(self.world, rng, self.propose, self.each)

    def of_photos(self, folder: Path, predicted: np.ndarray, rng: np.random.Generator) -> Lesson | None:
        """A photographed scene as it stands, with grasps on the predicted surface and on the true one."""
        record = read_record(folder, photos="none", trials=False)
        self.world.reset(replace(record.scene, materials=()))
        # Each pose is shown on the surface that it was drawn from alone: one from the truth has a better
        # chance to hold something, and the evaluator would learn to believe in what it cannot see.
        found = []
        for grid in (predicted, record.tsdf)[: 1 if self.predicted_only else 2]:
            poses = self.propose(grid, rng)
            found += explored(self.world, grid, poses, self.propose.candidates, rng, self.each)[0]
        return joined(found) if found else None


def predicted_surface(folder: Path, detector: NeuGraspDetector, cache: Path) -> np.ndarray:
    """What the detector makes of a record's photos (r, r, r), kept as float16."""
    if not cache.is_file():
        grid = detector.detect(read_record(folder, photos="inputs", trials=False).views()).tsdf
        cache.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(cache) as part, part.open("wb") as file:
            np.save(file, grid.astype(np.float16))
    return np.load(cache).astype(np.float32)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--objects", type=Path)
    parser.add_argument("--sets", default="pybullet,glassware", help="object sets where no folder is given")
    parser.add_argument("--scene", default="pile")
    parser.add_argument("--photos", type=Path, help="a folder of neugrasp generate, instead of new scenes")
    parser.add_argument("--weights", default="neugrasp", help="whose surfaces the photos become")
    parser.add_argument("--grids", type=Path, help="where these are kept; by default OUT/grids")
    parser.add_argument("--evaluator", help="an evaluator whose favourites are tried, too")
    parser.add_argument(
        "--predicted-only", action="store_true", help="of photos, not on the true surface, too"
    )
    parser.add_argument("--num", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="number of the first scene")
    parser.add_argument("--draws", type=int, default=100, help="grasps drawn in each state")
    parser.add_argument(
        "--each", type=int, default=1, help="grasps tried around one that closed on something"
    )
    parser.add_argument(
        "--heavy", type=int, default=0, help="how many times more often objects of over 1 kg are chosen"
    )
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--gripper", default="panda")
    options = parser.parse_args()
    library = ObjectLibrary.open(sets_of(options), options.objects)
    choices = library.choices("train", options.scene)
    heavy = [choice for choice in choices if library.model(*choice).mass > HEAVY] if options.heavy else []
    choices = (*choices, *(options.heavy * heavy))
    gripper, sums = Gripper.load(options.gripper), Counter[str]()
    judge = None
    if options.evaluator is not None:
        judge = Judge.load(options.evaluator, options.gripper, Workspace())
        judge.config = LIKED
    options.out.mkdir(parents=True, exist_ok=True)
    check_run_config(options.out / ABOUT, about_lessons(gripper), "set of lessons")
    folders = [] if options.photos is None else sorted((options.photos / "scenes").glob("[!.]*"))
    if options.photos is not None and not folders:
        raise SystemExit(f"{options.photos}: no records in scenes/")
    detector = NeuGraspDetector.load(options.weights, options.gripper) if folders else None
    last = options.first + options.num
    last = min(last, len(folders)) if folders else last
    with World(Workspace(), library, gripper) as world:
        propose = Proposals(Candidates(gripper), options.draws, judge)
        maker = Maker(world, propose, options.each, options.predicted_only)
        for index in range(options.first, last):
            name = folders[index].name if folders else f"{options.scene}-{options.seed}-{index:06d}"
            path, rng = options.out / f"{name}.npz", np.random.default_rng([options.seed, index])
            if path.is_file():
                continue
            try:
                if detector is None:
                    lesson = maker.of_truth(options.scene, choices, rng)
                else:
                    cache = (options.grids or options.out / "grids") / f"{name}.npy"
                    lesson = maker.of_photos(
                        folders[index], predicted_surface(folders[index], detector, cache), rng
                    )
            except NeuGraspError as error:
                tell(f"{name}: {error}")
                continue
            if lesson is None:
                continue
            write_lesson(path, lesson)
            sums.update({"scenes": 1, "grids": len(lesson.grids), "trials": len(lesson)})
            sums.update({"free": int(lesson.free.sum()), "held": int(lesson.success.sum())})
            if (index + 1) % 5 == 0:
                tell(f"{index + 1} of {last}: {dict(sums)}")


if __name__ == "__main__":
    main()
