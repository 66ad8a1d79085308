"""Grasps tried in a scene and stored one and all: as it stands, and with bodies taken away."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from neugrasp.data.trials import State, Trials, joined
from neugrasp.data.world import Scene
from neugrasp.execution import AT_PREGRASP, REASONS
from neugrasp.geometry.pose import Array, rotation_about
from neugrasp.simulation.batched_trials import execute_each
from neugrasp.simulation.grasp_execution import Trial
from neugrasp.simulation.grasp_sampling import candidates, grasp_poses
from neugrasp.simulation.mesh_distance import Library, mesh_distance
from neugrasp.simulation.physics import World

LARGEST_TILT = np.pi / 4
"""Radians between a tilted approach and the inward normal, at most."""


@dataclass(frozen=True)
class TrialSettings:
    """What is tried in a scene. The same values give the same trials."""

    points: int = 100
    """Points of the visible surface in each state."""
    tilted: float = 0.3
    """Share of the points at which the approach is tilted off the normal."""
    removed: tuple[int, ...] = (0, 1, 2)
    """How many bodies are taken away in the states in which grasps are tried."""
    keep_collisions: float = 1.0
    """Share of the trials that collide at the pre-grasp which is kept, drawn by chance."""
    yaws: int = 6
    seed: int = 0

    def told(self, gripper: str) -> dict[str, Any]:
        """The settings as `Trials.made` tells them; all else is kept in full."""
        numbers = {"points": self.points, "tilted": self.tilted, "removed": list(self.removed)}
        kept = {"keep_collisions_at_pregrasp": self.keep_collisions, "yaws": self.yaws, "seed": self.seed}
        return {"source": "states", "gripper": gripper, "rule": "paper", **numbers, **kept}


def run_trials(world: World, scene: Scene, library: Library, settings: TrialSettings) -> Trials | None:
    """Trials in a settled scene and in those that come of it when one body after another is taken away.

    What a hand would take is taken: the body that was held most often; by chance where none was. The others
    settle. None where nothing stands on the table.
    """
    rng = np.random.default_rng([settings.seed, scene.seed])
    scene, found, made = replace(scene, materials=()), None, settings.told(world.gripper.name)
    outcomes: Sequence[Trial] = ()
    for count in range(max(settings.removed) + 1):
        if count:
            world.remove(_easiest(outcomes, len(scene.bodies), rng))
            world.settle()
            scene, outcomes = replace(scene, bodies=world.bodies()), ()
        # From the stored poses, so that whoever rebuilds the state finds the world that was tried.
        world.reset(scene)
        if not scene.bodies:
            break
        if count in settings.removed:
            poses = tried_poses(world, rng, settings)
            outcomes = execute_each(world, poses)
            state = State(scene, mesh_distance(scene.bodies, library, world.workspace))
            kept = _kept(outcomes, rng, settings.keep_collisions)
            few = [outcome for outcome, is_kept in zip(outcomes, kept, strict=True) if is_kept]
            found = joined(found, as_trials(poses[kept], few, state, made))
    return found


def tried_poses(world: World, rng: np.random.Generator, settings: TrialSettings) -> Array:
    """TCP poses (n, 4, 4): at each point evenly spread yaws that begin anywhere.

    A tilted approach turns about the TCP, which stays before the surface where that of an upright one is;
    angle and azimuth are uniform.
    """
    points, rotations = candidates(world, rng, settings.points)
    tilts = np.where(rng.random(len(points)) < settings.tilted, rng.uniform(0, LARGEST_TILT, len(points)), 0)
    azimuths, phases = rng.uniform(0, 2 * np.pi, (2, len(points)))
    turned = [
        rotation_about((np.cos(azimuth), np.sin(azimuth), 0), tilt) @ rotation_about((0, 0, 1), phase)
        for azimuth, tilt, phase in zip(azimuths, tilts, phases, strict=True)
    ]
    tcps = points + world.gripper.tcp_depth * rotations[:, :, 2]
    return grasp_poses(tcps, rotations @ np.reshape(turned, (-1, 3, 3)), settings.yaws).reshape(-1, 4, 4)


def label_trials(
    poses: Array, outcomes: Sequence[Trial], state: State, gripper: str, rule: str = "paper"
) -> Trials:
    """All that was tried for the labels of a scene, at TCP poses (k, 4, 4)."""
    return as_trials(poses, outcomes, state, {"source": "labels", "gripper": gripper, "rule": rule})


def as_trials(poses: Array, outcomes: Sequence[Trial], state: State, made: Mapping[str, Any]) -> Trials:
    """What came of TCP poses (k, 4, 4) in one state, as a table."""
    count = len(outcomes)
    quaternions = np.zeros((0, 4)) if not count else Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    quaternions *= np.where(quaternions[:, 3:] < 0, -1, 1)
    return Trials(
        positions=poses[:, :3, 3].astype(np.float32),
        quaternions=quaternions.astype(np.float32),
        widths=np.array([outcome.width for outcome in outcomes], np.float32),
        success=np.array([outcome.success for outcome in outcomes], np.bool_),
        reasons=np.array([REASONS.index(outcome.reason) for outcome in outcomes], np.uint8),
        states=np.zeros(count, np.uint8),
        series=np.zeros(count, np.uint8),
        reason_names=REASONS,
        met=(state,),
        made=(made,),
    )


def _kept(outcomes: Sequence[Trial], rng: np.random.Generator, share: float) -> NDArray[np.bool_]:
    """Which trials are stored."""
    collided = np.array([outcome.reason == AT_PREGRASP for outcome in outcomes], np.bool_)
    kept: NDArray[np.bool_] = ~collided | (rng.random(len(outcomes)) < share)
    return kept


def _easiest(outcomes: Sequence[Trial], num_bodies: int, rng: np.random.Generator) -> int:
    """The number of the body that was held most often; any, where none was."""
    held = Counter(outcome.body for outcome in outcomes if outcome.body is not None)
    return held.most_common(1)[0][0] if held else int(rng.integers(num_bodies))
