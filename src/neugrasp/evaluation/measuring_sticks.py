"""Detectors that are told the truth: what a grasp head, or mere geometry, is worth on the true surface.

They take `Truth`, which only `robot.simulated_cameras.TruthCamera` makes; no other detector can be handed it.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from neugrasp.baselines.antipodal import antipodal_grasp
from neugrasp.baselines.vgn import INSIDE, vgn_selection
from neugrasp.detection.ask_head import predict_grasps
from neugrasp.detection.decode import SelectionConfig, select_grasps
from neugrasp.detection.detector import Detection
from neugrasp.detection.hand_check import HandCheck
from neugrasp.detection.judge import Judge
from neugrasp.gripper import Gripper
from neugrasp.model.grasp_head import GraspHead
from neugrasp.robot.simulated_cameras import Truth


@dataclass(frozen=True)
class Oracle:
    """A grasp head on the true TSDF."""

    head: GraspHead
    gripper: Gripper
    threshold: float
    is_vgn: bool
    """Whether the head is VGN's, which reads another scale, or NeuGrasp's own."""
    hand: HandCheck | None = None
    """What is asked of grasps of NeuGrasp's head besides."""

    def detect(self, truth: Truth) -> Detection:
        """What the head finds, best first."""
        if self.is_vgn:
            config = SelectionConfig(threshold=self.threshold, inside=INSIDE)
            chosen, tsdf = vgn_selection(self.head, truth.tsdf, truth.workspace, self.gripper, config)
        else:
            tsdf = truth.tsdf.values
            config = SelectionConfig(threshold=self.threshold, hand=self.hand)
            prediction = predict_grasps(self.head, tsdf)
            chosen = select_grasps(prediction, truth.workspace, self.gripper, config)
        placed = truth.workspace.world_from_workspace
        grasps = tuple(grasp.moved(placed) for grasp in chosen.grasps)
        return Detection(grasps, tsdf, chosen.rejected, chosen.best_rejected, {})


@dataclass(frozen=True)
class JudgedTruth:
    """The evaluator of grasps on the true TSDF."""

    judge: Judge

    def detect(self, truth: Truth) -> Detection:
        """What the judge finds, best first."""
        tsdf = truth.tsdf.values
        chosen = self.judge.find(tsdf, truth.workspace)
        placed = truth.workspace.world_from_workspace
        grasps = tuple(grasp.moved(placed) for grasp in chosen.grasps)
        threshold = self.judge.config.threshold
        return Detection(grasps, tsdf, chosen.rejected, chosen.best_rejected, {}, threshold)


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
        grasps = tuple(grasp.moved(placed) for grasp in drawn if grasp is not None)
        return Detection(grasps, tsdf, {"not_antipodal": self.num_candidates - len(grasps)}, 1.0, {})
