"""Grasps executed in physics: what holds, and what goes wrong with the rest.

    python examples/06_try_a_grasp.py --kind pile --num 10

In every scene one grasp is drawn at random among antipodal pairs of points of the true surface, which is what
geometry alone is worth. The hand comes from 5 cm behind it, closes where it is or where it is stopped, and
pulls back by 10 cm. It succeeds where something is then held between the pads. The reasons are those of
`neugrasp one-shot`, which does the same for a network on held-out scenes.

To try grasps of yours, make a `Grasp`: a pose whose z axis approaches, whose y axis closes the fingers and
whose origin is the point between the pads. Needs `pip install 'neugrasp[sim]'`.
"""

from __future__ import annotations

from collections import Counter
from typing import Literal

import numpy as np
import tyro

from neugrasp.baselines.antipodal import antipodal_grasp
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.metrics import wilson_interval
from neugrasp.simulation.arrange import arrange
from neugrasp.simulation.grasp_execution import execute
from neugrasp.simulation.gt_tsdf import scan
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World


def main(
    kind: Literal["pile", "packed", "single"] = "single",
    num: int = 5,
    gripper: str = "panda",
    seed: int = 0,
) -> None:
    """Tries one grasp in each of `num` scenes."""
    workspace = Workspace()
    library = ObjectLibrary.open(["pybullet", "glassware"])
    reasons: Counter[str] = Counter()
    with World(workspace, library, Gripper.load(gripper)) as world:
        for index in range(seed, seed + num):
            scene = arrange(kind, index, world, library.choices("test", kind))
            world.reset(scene)
            truth = scan(world, workspace)
            grasp = antipodal_grasp(truth.values, workspace, world.gripper, np.random.default_rng(index))
            if grasp is None:
                reasons["nothing fits between the fingers"] += 1
                continue
            trial = execute(world, grasp, allow_contact=True)
            reasons[trial.reason] += 1
            print(f"scene {index}: {trial.reason}, pads {trial.width * 1000:.0f} mm apart at the end")

    low, high = wilson_interval(reasons["success"], num)
    print(f"\nsuccess {reasons['success']} of {num} (95 % interval {low:.0%} to {high:.0%})")
    for reason, count in reasons.most_common():
        print(f"  {count} {reason}")


if __name__ == "__main__":
    tyro.cli(main)
