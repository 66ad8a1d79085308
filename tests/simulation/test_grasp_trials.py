"""Stored trials: all of those behind the labels, and further ones in states with bodies taken away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from neugrasp.data.trials import State, Trials
from neugrasp.data.world import Body, Scene
from neugrasp.execution import AT_PREGRASP, REASONS, SUCCESS
from neugrasp.geometry.pose import from_quaternion
from neugrasp.grasp import Grasp
from neugrasp.simulation.batched_trials import execute_each
from neugrasp.simulation.grasp_execution import execute
from neugrasp.simulation.grasp_sampling import candidates, label, middle_of_widest_run
from neugrasp.simulation.grasp_trials import (
    LARGEST_TILT,
    TrialSettings,
    label_trials,
    run_trials,
    tried_poses,
)
from neugrasp.simulation.mesh_distance import mesh_distance
from neugrasp.simulation.physics import World

pytestmark = pytest.mark.slow

TABLE = 0.05
FEW = TrialSettings(points=12, removed=(0, 1, 2), yaws=3)


@pytest.fixture(scope="module")
def settled(world: World) -> Scene:
    """Three toys at rest, far enough apart to be held."""
    places = {
        "box 0.04 0.04 0.06": (0.08, 0.1, TABLE + 0.031),
        "ball 0.025": (0.2, 0.12, TABLE + 0.0255),
        "box 0.05 0.03 0.05": (0.15, 0.22, TABLE + 0.026),
    }
    bodies = tuple(Body("toys", name, 1.0, place, (0.0, 0.0, 0.0, 1.0)) for name, place in places.items())
    world.reset(Scene("packed", 7, bodies))
    world.settle()
    return Scene("packed", 7, world.bodies())


@pytest.fixture(scope="module")
def trials(world: World, settled: Scene) -> Trials:
    """Those of `FEW`."""
    found = run_trials(world, settled, world._library, FEW)
    assert found is not None
    return found


def poses_of(trials: Trials) -> np.ndarray:
    return np.array(
        [from_quaternion(q, p) for q, p in zip(trials.quaternions, trials.positions, strict=True)]
    )


def test_the_labels_are_the_best_yaws_of_the_trials(world: World, settled: Scene) -> None:
    world.reset(settled)
    grasps = label(world, np.random.default_rng(0), num_points=10)
    labels = grasps.labels
    state = State(settled, mesh_distance(settled.bodies, world._library, world.workspace))
    trials = label_trials(grasps.poses, grasps.trials, state, "panda")
    assert len(trials) == 10 * 6
    depth, poses = world.gripper.tcp_depth, poses_of(trials).reshape(10, 6, 4, 4)
    success, widths = trials.success.reshape(10, 6), trials.widths.reshape(10, 6)
    assert 0 < labels.success.sum() < 10
    for i in range(10):
        best = middle_of_widest_run(success[i].tolist())
        assert labels.success[i] == (best is not None)
        chosen = poses[i, best or 0]
        labelled = from_quaternion(labels.quaternions[i], labels.points[i])
        np.testing.assert_allclose(labelled[:3, :3], chosen[:3, :3], atol=1e-6)
        # A label is a grasp point, a trial a TCP.
        np.testing.assert_allclose(labelled[:3, 3] + depth * chosen[:3, 2], chosen[:3, 3], atol=1e-6)
        assert labels.widths[i] == widths[i, best or 0]


def test_reasons_and_success_say_the_same(world: World, trials: Trials) -> None:
    assert trials.reason_names == REASONS
    assert np.array_equal(trials.success, trials.reasons == REASONS.index(SUCCESS))
    assert trials.success.any()
    assert np.all(trials.widths[~trials.success] == np.float32(world.gripper.max_opening))
    assert np.all(trials.widths[trials.success] < world.gripper.max_opening)


def test_each_state_lacks_one_body_more_and_has_its_own_distance(
    world: World, settled: Scene, trials: Trials
) -> None:
    assert [len(state.scene.bodies) for state in trials.met] == [3, 2, 1]
    assert trials.met[0].scene == settled
    assert np.bincount(trials.states).tolist() == [36, 36, 36]
    for state in trials.met:
        own = mesh_distance(state.scene.bodies, world._library, world.workspace)
        np.testing.assert_array_equal(state.distance, own)
        assert {body.name for body in state.scene.bodies} <= {body.name for body in settled.bodies}
    assert np.any(trials.met[0].distance < trials.met[1].distance)


def test_a_stored_state_and_pose_give_the_stored_outcome(world: World, trials: Trials) -> None:
    for number, state in enumerate(trials.met):
        world.reset(state.scene)
        there = trials.states == number
        again = execute_each(world, poses_of(trials)[there])
        found = np.array([REASONS.index(outcome.reason) for outcome in again])
        # Poses are stored to 10 nanometres: a grasp that touches by a hair may not.
        assert np.mean(found == trials.reasons[there]) > 0.95
    for k in np.flatnonzero(trials.success)[-4:]:
        world.reset(trials.met[trials.states[k]].scene)
        assert execute(world, Grasp(poses_of(trials)[k], world.gripper.max_opening)).success


@pytest.mark.slow
def test_the_same_settings_give_the_same_trials_whatever_was_before(
    world: World, settled: Scene, trials: Trials
) -> None:
    one = trials
    other = run_trials(world, settled, world._library, FEW)
    another = run_trials(world, settled, world._library, replace(FEW, seed=1))
    assert other is not None
    assert another is not None
    for name in ("positions", "quaternions", "widths", "reasons", "states"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert not np.array_equal(one.positions, another.positions)
    assert one.made == other.made != another.made


def test_only_the_states_that_are_asked_for_are_tried(world: World, settled: Scene) -> None:
    trials = run_trials(world, settled, world._library, replace(FEW, removed=(2,)))
    assert trials is not None
    assert [len(state.scene.bodies) for state in trials.met] == [1]
    assert run_trials(world, Scene("packed", 7, ()), world._library, FEW) is None
    few = run_trials(world, replace(settled, bodies=settled.bodies[:1]), world._library, FEW)
    assert few is not None
    assert [len(state.scene.bodies) for state in few.met] == [1]


def test_only_collisions_at_the_pregrasp_are_thinned(world: World, settled: Scene) -> None:
    settings = replace(FEW, removed=(0,), points=30)
    full = run_trials(world, settled, world._library, settings)
    thin = run_trials(world, settled, world._library, replace(settings, keep_collisions=0.3))
    assert full is not None
    assert thin is not None
    collided = [trials.reasons == REASONS.index(AT_PREGRASP) for trials in (full, thin)]
    np.testing.assert_array_equal(full.positions[~collided[0]], thin.positions[~collided[1]])
    assert 0 < collided[1].sum() < 0.5 * collided[0].sum()
    assert thin.made[0]["keep_collisions_at_pregrasp"] == 0.3


def test_tilts_are_uniform_about_a_tcp_that_stays(world: World, settled: Scene) -> None:
    world.reset(settled)
    count = 400
    all_tilted, none = (TrialSettings(points=count, tilted=share, yaws=2) for share in (1.0, 0.0))
    points, rotations = candidates(world, np.random.default_rng(0), count)
    tilted, upright = (
        tried_poses(world, np.random.default_rng(0), settings).reshape(-1, 2, 4, 4)
        for settings in (all_tilted, none)
    )
    # The TCP of a label's grasp there.
    tcps = points + world.gripper.tcp_depth * rotations[:, :, 2]
    for k in range(2):
        np.testing.assert_allclose(upright[:, k, :3, 3], tcps, atol=1e-12)
        np.testing.assert_allclose(tilted[:, k, :3, 3], tcps, atol=1e-12)
    np.testing.assert_allclose(upright[:, 0, :3, 2], rotations[:, :, 2], atol=1e-12)
    np.testing.assert_allclose(tilted[:, 0, :3, 2], tilted[:, 1, :3, 2], atol=1e-12)
    approaches = np.einsum("nji,nj->ni", rotations, tilted[:, 0, :3, 2])
    angles = np.arccos(np.clip(approaches[:, 2], -1, 1)) / LARGEST_TILT
    azimuths = (np.arctan2(approaches[:, 1], approaches[:, 0]) / (2 * np.pi)) % 1
    for share in (angles, azimuths):
        # Kolmogorov and Smirnov: 1.63 / sqrt(n) is passed once in a hundred.
        ranks = np.arange(1, len(share) + 1) / len(share)
        assert np.abs(np.sort(share) - ranks).max() < 1.63 / np.sqrt(len(share))
    closing = np.einsum("nji,nj->ni", rotations, upright[:, 0, :3, 1])
    yaws = (np.arctan2(closing[:, 1], closing[:, 0]) / np.pi) % 1
    assert len(np.unique(np.floor(10 * yaws))) == 10
