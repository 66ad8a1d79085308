"""Grasp trials per core and second, against one gripper loaded for each trial, and where the two disagree.

    python benchmarks/label_speed.py [--scenes 8] [--objects DIR] [--sets pybullet,glassware] [--gripper NAME]

Both try the same grasps in the same scenes, scene by scene in turn, in one process. Times are processor time,
so other load on the machine tells little. Where one grasp succeeds in one way only, the plain way tries it
again, shifted by a few nanometres: where those trials contradict one another, it has no verdict, either.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from neugrasp.execution import AT_PREGRASP, ON_APPROACH
from neugrasp.geometry.pose import Array
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.simulation.arrange import Choices, arrange
from neugrasp.simulation.batched_trials import execute_each
from neugrasp.simulation.grasp_execution import Trial, execute
from neugrasp.simulation.grasp_sampling import at_tcp, candidates, grasp_poses
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World

POINTS, YAWS = 120, 6
FIRST_SEED = 1000
SHIFTS_NM = (-5, -4, -3, -2, -1, 1, 2, 3, 4, 5)


def one_gripper_per_trial(world: World, poses: Array) -> list[Trial]:
    """The plain way: the scene is put back, a gripper is loaded, goes there in physics, and is removed."""
    world.remove_hand()
    settled = world.save()
    trials = []
    for pose in poses:
        world.restore(settled)
        trials.append(execute(world, Grasp(pose, world.gripper.max_opening)))
        world.remove_hand()
    world.restore(settled)
    world.forget(settled)
    return trials


def timed(
    run: Callable[[World, Array], list[Trial]], world: World, poses: Array
) -> tuple[float, list[Trial]]:
    start = time.process_time()
    trials = run(world, poses)
    return time.process_time() - start, trials


def collision(trial: Trial) -> str | None:
    return trial.reason if trial.reason in (AT_PREGRASP, ON_APPROACH) else None


def is_determined(world: World, pose: Array) -> bool:
    """Whether the plain way has one verdict on a grasp wherever within 5 nm it is tried."""
    shifted = np.repeat(pose[None], len(SHIFTS_NM), axis=0)
    shifted[:, :3, 3] += 1e-9 * np.array(SHIFTS_NM)[:, None]
    return len({trial.success for trial in one_gripper_per_trial(world, shifted)}) == 1


def compare(world: World, kind: str, choices: Choices, scenes: int) -> Counter[str]:
    """The sums behind a line of the report."""
    sums: Counter[str] = Counter()
    for seed in range(FIRST_SEED, FIRST_SEED + scenes):
        scene = arrange(kind, seed, world, choices)
        world.reset(scene)
        points, rotations = candidates(world, np.random.default_rng(seed), POINTS)
        poses = at_tcp(grasp_poses(points, rotations, YAWS), world.gripper).reshape(-1, 4, 4)
        fast_s, fast = timed(execute_each, world, poses)
        world.reset(scene)
        plain_s, plain = timed(one_gripper_per_trial, world, poses)
        pairs = list(zip(fast, plain, strict=True))
        differ = [k for k, (a, b) in enumerate(pairs) if a.success != b.success]
        sums["trials"] += len(poses)
        sums["free"] += sum(collision(trial) is None for trial in plain)
        sums["successes"] += sum(trial.success for trial in plain)
        sums["successes fast"] += sum(trial.success for trial in fast)
        sums["collisions differ"] += sum(collision(a) != collision(b) for a, b in pairs)
        sums["verdicts differ"] += len(differ)
        sums["determined"] += sum(is_determined(world, poses[k]) for k in differ)
        sums["fast us"] += round(1e6 * fast_s)
        sums["plain us"] += round(1e6 * plain_s)
    return sums


def describe(name: str, sums: Counter[str]) -> str:
    fast, plain = (1e6 * sums["trials"] / sums[key] for key in ("fast us", "plain us"))
    return (
        f"{name}: {sums['trials']} trials, {sums['free']} without collision\n"
        f"  per core and second: {fast:.0f}, one gripper per trial {plain:.0f}, ratio {fast / plain:.2f}\n"
        f"  successes {sums['successes fast']}, one gripper per trial {sums['successes']}\n"
        f"  collisions differ {sums['collisions differ']}, verdicts differ {sums['verdicts differ']}, "
        f"of these the plain way is sure of {sums['determined']}\n"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=8, help="scenes of each kind")
    parser.add_argument("--kinds", default="packed,pile")
    parser.add_argument("--objects", type=Path, help="a folder of URDF files, as for neugrasp generate")
    parser.add_argument("--sets", default="pybullet,glassware", help="object sets where no folder is given")
    parser.add_argument("--gripper", default="panda")
    options = parser.parse_args()
    sets = options.sets.split(",") if options.objects is None else ["folder"]
    library = ObjectLibrary.open(sets, options.objects)
    for kind in options.kinds.split(","):
        with World(Workspace(), library, Gripper.load(options.gripper)) as world:
            sums = compare(world, kind, library.choices("train", kind), options.scenes)
        sys.stdout.write(describe(kind, sums))
        sys.stdout.flush()


if __name__ == "__main__":
    main()
