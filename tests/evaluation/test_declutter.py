"""The loop: who wins, who loses, when it ends, and what a detector gets to know."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from neugrasp.data.world import Cell, Scene
from neugrasp.detection.contract import Detection
from neugrasp.detection.registry import DEPTH, GROUP, PHOTOS, TRUTH, detector_spec
from neugrasp.evaluation.declutter import EpisodeConfig, SurfaceError, declutter
from neugrasp.evaluation.episode import Episode
from neugrasp.evaluation.ground_truth import SimulatedGroundTruth
from neugrasp.evaluation.protocols import PROTOCOLS, STRATEGIES, protocol_of, strategy_of
from neugrasp.evaluation.scores import scores
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasps
from neugrasp.metrics import l1_by_mask
from neugrasp.observation import Views, with_depth
from neugrasp.robot.interface import Robot
from neugrasp.robot.simulated import SimulatedRobot
from neugrasp.robot.simulated_cameras import DepthCamera, PhotoCamera, RgbdCamera, TruthCamera
from neugrasp.simulation.cell import sample_cell
from neugrasp.simulation.physics import World
from toy_boxes import AirGrasper, Blind, Boxes, Cheat, box, boxes_scene, detection, grasp_of

UP = np.array([0.0, 0.0, 1.0])
THREE = (box(0.08, 0.08), box(0.22, 0.1), box(0.15, 0.22))


def draw(index: int, attempt: int) -> np.random.Generator:
    return np.random.default_rng([index, attempt])


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    with World(Workspace(), Boxes(tmp_path_factory.mktemp("boxes"))) as world:
        yield world


class NoCamera:
    """Shows nothing."""

    def capture(self) -> None:
        return None


class Notary:
    """A ground truth without an opinion."""

    def surface_error(self, detection: Detection) -> SurfaceError:
        return SurfaceError({}, {})

    def describe(self) -> dict[str, Any]:
        return {}


@pytest.fixture
def play(world: World) -> Callable[..., Episode]:
    def playing(detector: Any, *bodies: Any, strategy: str = "top", **rules: Any) -> Episode:
        robot = SimulatedRobot(world, boxes_scene(*bodies))
        config = EpisodeConfig(replace(protocol_of("paper"), **rules), strategy_of(strategy), draw, UP)
        return declutter(config, 7, Robot(NoCamera(), robot, robot), detector, Notary())

    return playing


@pytest.mark.parametrize("strategy", sorted(STRATEGIES))
def test_a_perfect_detector_clears_easy_boxes(play: Callable[..., Episode], world: World, strategy: str):
    episode = play(Cheat(world), *THREE, strategy=strategy)
    assert episode.ending == "table empty"
    assert [attempt.objects for attempt in episode.attempts] == [3, 2, 1]
    assert all(attempt.success and attempt.round == 7 for attempt in episode.attempts)
    result = scores([episode], protocol_of("paper"))
    assert (result["SR"], result["FSR"], result["DR"]) == (100, 100, 100)


def test_a_detector_that_grasps_air_scores_nothing_and_stops_after_two(play: Callable[..., Episode]):
    episode = play(AirGrasper(), *THREE)
    assert episode.ending == "failures in a row"
    assert [attempt.reason for attempt in episode.attempts] == ["nothing between the fingers"] * 2
    result = scores([episode], protocol_of("paper"))
    assert (result["SR"], result["FSR"], result["DR"]) == (0, 0, 0)
    assert result["failures"]["nothing between the fingers"] == 2


class Stubborn:
    """Likes best to close above the first box, where nothing is; knows the others."""

    def __init__(self, world: World):
        self.world = world

    def detect(self, views: object) -> Detection:
        first, *others = self.world.bodies()
        above = replace(grasp_of(first, depth=-0.05), score=1.0)
        return detection(above, *(replace(grasp_of(body), score=0.5) for body in others))


def test_by_the_protocols_a_grasp_that_failed_is_tried_again(play: Callable[..., Episode], world: World):
    episode = play(Stubborn(world), *THREE)
    assert [attempt.success for attempt in episode.attempts] == [False, False]
    assert episode.ending == "failures in a row"


def test_elsewhere_first_what_failed_is_tried_last_and_then_given_up(
    play: Callable[..., Episode], world: World
):
    # Three failures in a row are allowed, so that it is the place that is given up, not the round.
    episode = play(Stubborn(world), *THREE, after_failure="elsewhere", max_failures=3)
    assert [attempt.success for attempt in episode.attempts] == [False, True, True, False]
    assert (episode.ending, episode.skipped) == ("only where grasps failed", {"failed there before": 1})
    result = scores([episode], protocol_of("paper"))
    assert result["endings"]["only where grasps failed"] == 1
    assert (result["SR"], round(result["DR"])) == (50, 67)


def test_a_round_ends_where_nothing_is_detected(play: Callable[..., Episode]):
    episode = play(Blind(), *THREE)
    assert (episode.ending, episode.attempts, episode.objects) == ("nothing detected", (), 3)


def test_a_success_forgives_the_failure_before_it(play: Callable[..., Episode], world: World):
    class Clumsy:
        """Every other grasp goes into the air."""

        looks = 0

        def detect(self, views: object) -> Detection:
            self.looks += 1
            player = AirGrasper() if self.looks % 2 else Cheat(world)
            return player.detect(views)

    episode = play(Clumsy(), *THREE)
    assert [attempt.success for attempt in episode.attempts] == [False, True] * 3
    assert episode.ending == "table empty"


def test_an_object_pushed_off_the_table_is_told_and_not_counted(play: Callable[..., Episode], world: World):
    class Clearer:
        """While it looks, another hand sweeps a box away; then it grasps air."""

        def detect(self, views: object) -> Detection:
            return detection(AirGrasper().detect(views).grasps[0])

    class Sweeping(SimulatedRobot):
        def retract(self) -> None:
            world.place(0, box(0.5, 0.5))
            super().retract()

    robot = Sweeping(world, boxes_scene(*THREE[:2]))
    config = EpisodeConfig(protocol_of("paper"), strategy_of("top"), draw, UP)
    episode = declutter(config, 0, Robot(NoCamera(), robot, robot), Clearer(), Notary())
    assert [attempt.lost for attempt in episode.attempts] == [1, 1]
    assert {attempt.reason for attempt in episode.attempts} == {"carried away from the table"}
    result = scores([episode], protocol_of("paper"))
    assert (result["DR"], result["lost_objects"], result["objects"]) == (0, 2, 2)


def test_strategies_choose_what_they_say():
    from dataclasses import replace

    grasps = [
        replace(grasp_of(body), score=score) for body, score in zip(THREE, (0.95, 0.99, 0.91), strict=True)
    ]
    high = replace(grasps[2], pose=grasps[2].pose + np.array([[0, 0, 0, 0]] * 2 + [[0, 0, 0, 0.1], [0] * 4]))
    grasps[2] = high
    rng = np.random.default_rng(0)
    assert STRATEGIES["top"](grasps, rng, UP) == 1
    assert STRATEGIES["highest"](grasps, rng, UP) == 2
    drawn = [STRATEGIES["random"](grasps, rng, UP) for _ in range(300)]
    assert min(np.bincount(drawn, minlength=3)) > 70


def test_the_named_protocols_differ_as_their_papers_do():
    paper, vgn, graspnerf = (PROTOCOLS[name] for name in ("paper", "vgn", "graspnerf"))
    assert (paper.min_opening, vgn.min_opening, graspnerf.min_opening) == (0.05, 0.1, 0.1)
    assert (paper.table_contact, vgn.table_contact, graspnerf.table_contact) == (True, True, False)
    assert (paper.count_silent_rounds, graspnerf.count_silent_rounds) == (True, False)


class Spy:
    """Keeps, as bytes, all that it was ever shown."""

    def __init__(self) -> None:
        self.seen: list[bytes] = []
        self.kinds: list[type] = []

    def detect(self, views: object) -> Detection:
        self.seen.append(pickle.dumps(views))
        self.kinds.append(type(views))
        return AirGrasper().detect(views)


class OnePhoto:
    """A scene renderer to whom all scenes look the same."""

    def render(
        self, cell: Cell, scene: Scene | None, library: object, camera_indices: Sequence[int]
    ) -> list[np.ndarray]:
        return [np.full((c.height, c.width, 3), 90, dtype=np.uint8) for c in cell.cameras]


def shown(world: World, *bodies: Any) -> Spy:
    """What a detector of photos sees in a round, everything but the photos being as usual."""
    cell = sample_cell(world.workspace, "released", 3, "test", size=16, num_targets=0)
    scene_renderer: Any = OnePhoto()
    empty = np.stack(scene_renderer.render(cell, None, None, range(4)))
    robot = SimulatedRobot(world, boxes_scene(*bodies))
    camera = PhotoCamera(robot, cell, empty, scene_renderer, Boxes, world.workspace)  # type: ignore[arg-type]
    ground_truth = SimulatedGroundTruth(robot, TruthCamera(world))
    config = EpisodeConfig(protocol_of("paper"), strategy_of("top"), draw, UP)
    spy = Spy()
    declutter(config, 0, Robot(camera, robot, robot), spy, ground_truth)
    return spy


@pytest.mark.slow
def test_scenes_that_look_alike_are_the_same_to_the_last_byte_for_a_detector(world: World):
    """Whatever it is handed follows from photos and cameras; the truth is judged beside it all the while."""
    one, three = shown(world, THREE[0]), shown(world, *THREE)
    assert set(one.kinds) == {Views}
    assert one.seen == three.seen
    assert len(set(one.seen)) == 1


def test_only_measuring_sticks_are_told_the_truth():
    specs = {point.name: detector_spec(point.name) for point in entry_points(group=GROUP)}
    assert {name for name, spec in specs.items() if spec.observes == TRUTH} >= {"oracle", "antipodal"}
    assert (specs["neugrasp"].observes, specs["vgn"].observes) == (PHOTOS, DEPTH)


def test_a_detector_of_colour_and_depth_sees_both_from_the_same_places(world: World, tmp_path: Path):
    robot = SimulatedRobot(world, boxes_scene(THREE[0]))
    cell = sample_cell(world.workspace, "released", 0, "test", size=32, num_targets=0)
    black = [np.zeros((32, 32, 3), np.uint8)] * cell.num_inputs

    class Black:
        def render(self, *_: object) -> list[np.ndarray]:
            return black

    photos = PhotoCamera(robot, cell, black, Black(), Boxes(tmp_path), world.workspace)
    seen = RgbdCamera(photos, DepthCamera(world, cell.cameras[: cell.num_inputs])).capture()
    assert seen.channels == {"image", "background", "depth"}
    assert [frame.camera for frame in seen.frames] == list(cell.cameras[: cell.num_inputs])
    assert with_depth(seen).frames[0].depth.max() > 0.1


def test_depth_cameras_measure_the_table(world: World):
    robot = SimulatedRobot(world, boxes_scene(THREE[0]))
    cell = sample_cell(world.workspace, "released", 0, "test", size=32, num_targets=0)
    seen = DepthCamera(world, cell.cameras).capture()
    exact = [world.depth_and_mask(camera)[0] for camera in cell.cameras]
    assert all(np.array_equal(v.depth, d) for v, d in zip(seen.frames, exact, strict=True))
    doubled = DepthCamera(world, cell.cameras, lambda depth: 2 * depth).capture()
    assert np.array_equal(doubled.frames[0].depth, 2 * exact[0])
    assert robot.count() == 1


@pytest.mark.slow
def test_constant_predictors_come_out_as_measured_elsewhere(world: World):
    """Bounds measured with an independent fusion of a table with five boxes."""
    five = (*THREE, box(0.08, 0.2), box(0.22, 0.2))
    robot = SimulatedRobot(world, boxes_scene(*five))
    error = SimulatedGroundTruth(robot, TruthCamera(world)).surface_error(detection())
    expected = {
        "-1": {"1.0": (0.46, 0.51), "0.5": (0.71, 0.77), "0.3": (0.90, 0.94), "0.1": (0.92, 0.96)},
        "+0": {"1.0": (0.49, 0.54), "0.5": (0.24, 0.29), "0.3": (0.06, 0.11), "0.1": (0.05, 0.08)},
        "+1": {"1.0": (1.48, 1.54), "0.5": (1.23, 1.29), "0.3": (1.06, 1.10), "0.1": (1.05, 1.08)},
    }
    for value, masks in expected.items():
        for mask, (low, high) in masks.items():
            assert low <= error.constants[value][mask] <= high, (value, mask)
    # A surface that is nowhere says +1 everywhere.
    assert error.l1 == error.constants["+1"]


@pytest.mark.slow
def test_the_true_surface_has_no_error(world: World):
    from neugrasp.geometry.fusion import vgn_grid

    robot = SimulatedRobot(world, boxes_scene(*THREE))
    truth = TruthCamera(world)
    true = 2 * vgn_grid(truth.capture().tsdf) - 1
    found = Detection(Grasps.of(()), world.workspace, world.gripper, true)
    error = SimulatedGroundTruth(robot, truth).surface_error(found)
    assert error.l1 == dict.fromkeys(l1_by_mask(0.0, true), 0.0)
    assert truth.capture() is truth.capture()
    world.remove(0)
    assert not np.array_equal(2 * vgn_grid(truth.capture().tsdf) - 1, true)
