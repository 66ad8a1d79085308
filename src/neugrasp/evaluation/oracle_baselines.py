"""Detectors that are told the truth: what a grasp head, or mere geometry, is worth on the true surface.

They take `Truth`, which only `robot.simulated_cameras.TruthCamera` makes; no other detector can be handed it.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from neugrasp.baselines.antipodal import antipodal_grasp
from neugrasp.baselines.vgn import VgnHead, is_public, selection_of, vgn_facts, vgn_selection
from neugrasp.detection.candidates import Candidates
from neugrasp.detection.collision_filter import CollisionFilter
from neugrasp.detection.contract import Detection
from neugrasp.detection.decode import SelectionConfig, select_grasps
from neugrasp.detection.detector import facts_of, threshold_of
from neugrasp.detection.judge import Judge, judge_facts
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import TRUTH, DetectorSpec
from neugrasp.detection.test_time_augmentation import predict_grasps
from neugrasp.geometry.workspace import USUAL
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.model.checkpoint import load_checkpoint
from neugrasp.model.grasp_head import GraspHead
from neugrasp.robot.simulated_cameras import Truth


@dataclass(frozen=True)
class Oracle:
    """A grasp head on the true TSDF."""

    head: GraspHead | VgnHead
    """NeuGrasp's own, or VGN's, which reads another scale."""
    gripper: Gripper
    threshold: float
    hand: CollisionFilter | None = None
    """What is asked of grasps of NeuGrasp's head besides."""

    def detect(self, truth: Truth) -> Detection:
        """What the head finds, best first."""
        if isinstance(self.head, VgnHead):
            config = selection_of(self.head, self.threshold)
            chosen, tsdf = vgn_selection(self.head, truth.tsdf, truth.workspace, self.gripper, config)
        else:
            tsdf = truth.tsdf.values
            config = SelectionConfig(threshold=self.threshold, hand=self.hand)
            prediction = predict_grasps(self.head, tsdf)
            chosen = select_grasps(prediction, truth.workspace, self.gripper, config)
        return chosen.detection(truth.workspace, self.gripper, tsdf, self.threshold)


@dataclass(frozen=True)
class JudgedTruth:
    """The evaluator of grasps on the true TSDF."""

    judge: Judge

    def detect(self, truth: Truth) -> Detection:
        """What the judge finds, best first."""
        tsdf = truth.tsdf.values
        chosen = self.judge.find(tsdf, truth.workspace)
        return chosen.detection(truth.workspace, self.judge.gripper, tsdf, self.judge.config.threshold)


@dataclass(frozen=True)
class Antipodal:
    """Random antipodal candidates on the true surface, all equally good."""

    gripper: Gripper
    seed: int
    num_candidates: int = 12

    def detect(self, truth: Truth) -> Detection:
        """Candidates in random order; which ones depends on the surface and the seed alone."""
        tsdf = truth.tsdf.values
        rng = np.random.default_rng([self.seed, zlib.crc32(tsdf.tobytes())])
        drawn = (
            antipodal_grasp(tsdf, truth.workspace, self.gripper, rng) for _ in range(self.num_candidates)
        )
        placed = truth.workspace.world_from_workspace
        grasps = Grasps.of(grasp.moved(placed) for grasp in drawn if grasp is not None)
        rejected = {"not_antipodal": self.num_candidates - len(grasps)}
        return Detection(grasps, truth.workspace, self.gripper, tsdf, rejected)


@dataclass(frozen=True)
class PerfectJudge:
    """Knows of each candidate whether it holds, because physics has tried it: what no detector can surpass
    that draws its grasps from a surface."""

    candidates: Candidates
    seed: int
    draws: tuple[int, ...] = (24, 48, 96, 192, 384)
    """Candidates that are drawn and tried, more and more until one of them holds."""

    def detect(self, truth: Truth) -> Detection:
        """Those that hold, in random order, all equally good."""
        tsdf, gripper = truth.tsdf.values, self.candidates.gripper
        rng = np.random.default_rng([self.seed, zlib.crc32(tsdf.tobytes())])
        held, failed = np.zeros((0, 4, 4)), 0
        for count in self.draws:
            poses = self.candidates.draw(tsdf, truth.workspace, rng, count)
            holds = truth.holds(poses)
            held, failed = poses[holds], failed + int(np.count_nonzero(~holds))
            if len(held):
                break
        placed = truth.workspace.world_from_workspace
        grasps = Grasps.of(Grasp(pose, gripper.max_opening).moved(placed) for pose in held)
        return Detection(grasps, truth.workspace, gripper, tsdf, {"failed_when_tried": failed})


def _oracle(options: DetectorOptions) -> Oracle:
    gripper = Gripper.load(options.gripper)
    if is_public(options.weights):
        head = VgnHead.load(options.weights)
        return Oracle(head, gripper, selection_of(head, options.threshold).threshold)
    checkpoint = load_checkpoint(options.weights)
    hand = CollisionFilter(gripper) if options.hand_check else None
    threshold = threshold_of(checkpoint.about, options.threshold)
    return Oracle(checkpoint.model().head, gripper, threshold, hand)


def _oracle_facts(options: DetectorOptions) -> dict[str, Any]:
    return vgn_facts(options) if is_public(options.weights) else facts_of(options)


def _judged(options: DetectorOptions) -> JudgedTruth:
    return JudgedTruth(Judge.load(options.evaluator, options.gripper, USUAL, options.threshold))


def _judged_facts(options: DetectorOptions) -> dict[str, Any]:
    return judge_facts(options, USUAL)


def _perfect(options: DetectorOptions) -> PerfectJudge:
    return PerfectJudge(Candidates(Gripper.load(options.gripper)), options.seed)


def _antipodal(options: DetectorOptions) -> Antipodal:
    return Antipodal(Gripper.load(options.gripper), options.seed)


ORACLE = DetectorSpec(TRUTH, _oracle, _oracle_facts)
JUDGED = DetectorSpec(TRUTH, _judged, _judged_facts)
ANTIPODAL = DetectorSpec(TRUTH, _antipodal)
PERFECT = DetectorSpec(TRUTH, _perfect)
