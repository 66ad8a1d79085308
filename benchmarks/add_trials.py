"""Executes further grasps in the scenes of a data set and stores every trial (docs/data_format.md).

    python benchmarks/add_trials.py FOLDER [--objects DIR] [--sets pybullet,glassware] [--workers N]
        [--points 100] [--tilted 0.3] [--removed 0,1,2] [--keep-collisions 0.15] [--seed 0]

Physics only: scenes are rebuilt from world.json. With `--removed 0,1,2` grasps are tried in the scene as it
is, and with one and two bodies taken away; each such state is stored with its mesh distance. Records that
have the trials of these very options are left alone, so a run that was stopped goes on where it was; other
options, such as another seed, add more. Each record is changed at once or not at all.
"""

from __future__ import annotations

from collections import Counter
from functools import lru_cache, partial
from pathlib import Path

from over_records import over_records, parser, sets_of

from neugrasp.data.records import TRIALS_FILE, read_trials
from neugrasp.data.trials import joined, trials_to_bytes
from neugrasp.data.world import scene_from_json
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.output import whole_file
from neugrasp.simulation.grasp_trials import TrialSettings, run_trials
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World


@lru_cache(maxsize=1)
def world_of(library: ObjectLibrary, gripper: str) -> World:
    return World(Workspace(), library, Gripper.load(gripper))


def add(
    folder: Path, sets: tuple[str, ...], objects: Path | None, gripper: str, settings: TrialSettings
) -> Counter[str] | None:
    before, file = read_trials(folder), folder / "world.json"
    if before is not None and settings.told(gripper) in before.made:
        return None
    if not file.is_file():
        raise InputError(f"{file}: missing; FOLDER must be a data set of neugrasp generate")
    library = ObjectLibrary.open(sets, objects)
    world = world_of(library, gripper)
    found = run_trials(world, scene_from_json(file.read_text(), file), library, settings)
    if found is None:
        return None
    with whole_file(folder / TRIALS_FILE) as part:
        part.write_bytes(trials_to_bytes(joined(before, found)))
    names = [found.reason_names[reason] for reason in found.reasons]
    return Counter(names) + Counter({"trials stored": len(found), "states": len(found.met)})


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--points", type=int, default=100, help="points of the surface in each state")
    options.add_argument("--tilted", type=float, default=0.3, help="share of points with a tilted approach")
    options.add_argument("--removed", default="0,1,2", help="how many bodies are taken away, in each state")
    options.add_argument(
        "--keep-collisions", type=float, default=1.0, help="share of collisions at the pre-grasp to store"
    )
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--gripper", default="panda")
    chosen = options.parse_args()
    settings = TrialSettings(
        points=chosen.points,
        tilted=chosen.tilted,
        removed=tuple(sorted({int(count) for count in chosen.removed.split(",")})),
        keep_collisions=chosen.keep_collisions,
        seed=chosen.seed,
    )
    work = partial(
        add, sets=sets_of(chosen), objects=chosen.objects, gripper=chosen.gripper, settings=settings
    )
    over_records(chosen, work)


if __name__ == "__main__":
    main()
