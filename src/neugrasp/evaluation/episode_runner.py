"""Plays rounds one after the other in one process; which came before makes no difference."""

from __future__ import annotations

import logging
import time
import traceback
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from neugrasp.baselines.depth_noise import NoisyDepth
from neugrasp.detection.registry import DEPTH, TRUTH, detector_spec
from neugrasp.errors import InputError, WriteError
from neugrasp.evaluation.background_cache import background_folder
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.declutter import EpisodeConfig, Log, declutter
from neugrasp.evaluation.episode import CRASHED, Episode
from neugrasp.evaluation.ground_truth import SimulatedGroundTruth
from neugrasp.evaluation.protocols import EvaluationRules, protocol_of, strategy_of
from neugrasp.evaluation.results_io import scene_of, workspace_of
from neugrasp.evaluation.rounds import Round, Rounds
from neugrasp.geometry.pose import Array
from neugrasp.gripper import Gripper
from neugrasp.robot.attended import Attendant
from neugrasp.robot.cell_file import read_cell
from neugrasp.robot.interface import Camera, Robot
from neugrasp.robot.rehearsal import Rehearsal, rehearsed
from neugrasp.robot.simulated import SimulatedRobot
from neugrasp.robot.simulated_cameras import DepthCamera, PhotoCamera, RgbdCamera, TruthCamera
from neugrasp.robot.simulated_stereo import StereoCamera, StereoRgbdCamera
from neugrasp.robot.tour import TouringCamera
from neugrasp.robot.twin import TwinRobot
from neugrasp.robot.workcell import moved_to, planner_of, tour_of
from neugrasp.simulation.cell_photos import SceneRenderer, backgrounds
from neugrasp.simulation.lab import domain_of
from neugrasp.simulation.objects import ObjectLibrary, OneFriction
from neugrasp.simulation.physics import World
from neugrasp.simulation.renderer import RenderSettings
from neugrasp.terminal import printable

log = logging.getLogger(__name__)


def needs_scene_renderer(config: Evaluate) -> bool:
    """Whether anything has to be rendered for the detector."""
    observes = detector_spec(config.detector).observes
    return "image" in observes or (observes == DEPTH and config.depth == "stereo")


class EpisodeRunner:
    """The world, the rounds and the detector of one evaluation."""

    def __init__(
        self,
        config: Evaluate,
        scene_renderer: SceneRenderer | None,
        rules: EvaluationRules | None = None,
        speed: float = 1.0,
    ):
        self.config = config
        self.rules = replace(rules or protocol_of(config.protocol), after_failure=config.after_failure)
        self._scene_renderer = scene_renderer
        self._library = ObjectLibrary.open(config.object_sets, config.objects)
        self._rounds = Rounds(
            config.scene,
            config.seed,
            self._library,
            config.materials,
            config.views,
            self.rules.num_objects,
            split=config.split,
            domain=domain_of(config.domain),
        )
        friction = self.rules.object_friction or self._rounds.domain.friction
        library = self._library if friction is None else OneFriction(self._library, friction)
        self._spec = detector_spec(config.detector)
        workspace = workspace_of(self._spec.facts(config.options()))
        self.world = World(workspace, library, Gripper.load(config.gripper))
        self._cell = (
            None if config.cell is None else moved_to(read_cell(config.cell), workspace).at_speed(speed)
        )
        self.detector = self._spec.load(config.options())
        strategy = self.rules.strategy if config.strategy == "protocol" else config.strategy
        up: Array = self.world.workspace.world_from_workspace[:3, 2]
        self._episode_config = EpisodeConfig(self.rules, strategy_of(strategy), self._rounds.choice_rng, up)

    def play(self, index: int) -> Episode:
        """Round `index`; where it crashes, that is what comes back."""
        start = time.perf_counter()
        try:
            return self.play_on(index, Log())
        except (InputError, WriteError):
            raise
        except Exception as error:
            log.exception("round %d crashed", index)
            seconds = {"crash": time.perf_counter() - start}
            details = printable(traceback.format_exception_only(error)[-1].strip())
            return Episode(index, 0, CRASHED, error=details, timing_s=seconds)

    def play_on(self, index: int, log: Log, attendants: Sequence[Attendant] = ()) -> Episode:
        """Round `index`, or the rest of it; what goes wrong is raised. Attendants are told before an arm
        moves."""
        start = time.perf_counter()
        fixed = self.round(index)
        if log.begun is not None and log.begun.left is not None:
            fixed = replace(fixed, scene=scene_of(log.begun.left))
        arranged = time.perf_counter()
        truth = TruthCamera(self.world)
        robot, table = self.robot(fixed, truth, attendants)
        prepared = time.perf_counter()
        ground_truth = SimulatedGroundTruth(table, truth)
        episode = declutter(self._episode_config, index, robot, self.detector, ground_truth, log)
        seconds = {"arrange": arranged - start, "prepare": prepared - arranged, **episode.timing_s}
        return replace(episode, scene_sha256=fixed.scene_sha256, timing_s=seconds)

    def round(self, index: int) -> Round:
        """What is fixed about round `index`; the world holds something else afterwards."""
        return self._rounds.make(index, self.world)

    def robot(
        self, fixed: Round, truth: TruthCamera, attendants: Sequence[Attendant] = ()
    ) -> tuple[Robot[Any], SimulatedRobot]:
        """The floating hand, or the arm of a cell, and the table that it clears, as a round begins."""
        if self._cell is None:
            floating = SimulatedRobot(self.world, fixed.scene, self.rules.table_contact)
            return Robot(self._camera(fixed, floating, truth), floating, floating), floating
        cell, motion = self._cell, planner_of(self._cell)
        twin = TwinRobot(self.world, fixed.scene, cell, motion, attendants)
        views = [replace(cell.camera.camera, world_from_camera=s.world_from_camera) for s in fixed.sensors]
        eyes = self._camera(fixed, twin.table, truth)
        camera = TouringCamera(twin.arm, tour_of(cell, motion, views), eyes)
        return Robot(camera, twin.manipulator, twin.table), twin.table

    def capture(self, index: int) -> Any:
        """What the detector sees as round `index` begins; the world stands so afterwards."""
        robot, _ = self.robot(self.round(index), TruthCamera(self.world))
        return robot.camera.capture()

    def rehearse(self, index: int) -> Rehearsal:
        """What the arm would do first in round `index`; it does not move."""
        fixed = self.round(index)
        robot, _ = self.robot(fixed, TruthCamera(self.world))
        assert self._cell is not None
        assert isinstance(robot.camera, TouringCamera)
        detection = self.detector.detect(robot.camera.camera.capture())
        config, rng = self._episode_config, self._episode_config.rng(index, 0)
        return rehearsed(
            self._cell,
            planner_of(self._cell),
            robot.camera.tour,
            detection,
            lambda grasps: config.choose(grasps, rng, config.up),
        )

    def _camera(self, fixed: Round, robot: SimulatedRobot, truth: TruthCamera) -> Camera[Any]:
        """The eyes of the detector; only measuring sticks get the truth."""
        observes = self._spec.observes
        if observes == TRUTH:
            return truth
        noise = NoisyDepth(self.config.seed) if self.config.depth == "noisy" else None
        if "image" in observes:
            assert self._scene_renderer is not None
            settings, domain = RenderSettings(samples=self.config.samples), self._rounds.domain.facts()
            folder = background_folder(fixed.cell, settings, domain)
            empty = backgrounds(fixed.cell, folder, self._scene_renderer, self._library)
            photos = PhotoCamera(
                robot, fixed.cell, empty, self._scene_renderer, self._library, self.world.workspace
            )
            if "depth" not in observes:
                return photos
            if self.config.depth == "stereo":
                return StereoRgbdCamera(photos)
            depths = DepthCamera(self.world, fixed.cell.cameras[: fixed.cell.num_inputs], noise)
            return RgbdCamera(photos, depths)
        if self.config.depth == "stereo":
            assert self._scene_renderer is not None
            return StereoCamera(
                robot, fixed.cell, fixed.sensors, self._scene_renderer, self._library, self.world.workspace
            )
        return DepthCamera(self.world, fixed.sensors, noise)
