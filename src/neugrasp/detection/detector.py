"""The one interface of everything that finds grasps, and NeuGrasp behind it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neugrasp.detection.ask_head import predict_grasps
from neugrasp.detection.decode import Prediction, Selection, SelectionConfig, select_grasps
from neugrasp.detection.hand_check import HandCheck
from neugrasp.detection.judge import Judge
from neugrasp.errors import InputError
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.model.checkpoint import load_checkpoint
from neugrasp.model.inputs import ViewTensors, prepare
from neugrasp.model.network import NeuGrasp
from neugrasp.views import Views


@dataclass(frozen=True)
class Detection:
    """What a detector found."""

    grasps: tuple[Grasp, ...]
    """In the user's world, best first."""
    tsdf: NDArray[np.float32]
    """(r, r, r) in [-1, 1], indexed [x, y, z] in the workspace frame."""
    rejected: dict[str, int]
    """How many of the voxels each rule rejected."""
    best_rejected: float
    """The best quality of any voxel near a surface."""
    timing_s: dict[str, float]
    """Seconds of each stage."""
    threshold: float | None = None
    """The quality below which nothing is a grasp, where the detector has one."""


class Detector(Protocol):
    """Anything that finds grasps in views."""

    def detect(self, views: Views) -> Detection:
        """Ranked grasps of a scene."""
        ...


class Stopwatch:
    """Seconds by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time of the block to stage `name`."""
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


HINTS = 0.3
"""Smoothed quality from which the head's peaks are judged beside what is drawn from the surface."""


class NeuGraspDetector:
    """Photos to grasps with the network. Features of the last backgrounds are kept and reused.

    With a `judge` the head only proposes; what is a grasp, and how sure, the evaluator says.

    One detector serves many threads, and many cells in turn.
    """

    def __init__(
        self,
        model: NeuGrasp,
        gripper: Gripper,
        selection: SelectionConfig | None = None,
        device: str | torch.device = "cpu",
        judge: Judge | None = None,
    ):
        self.model = model.to(device).eval()
        self.gripper = gripper
        self.selection = selection or SelectionConfig()
        self.device = torch.device(device)
        self.judge = judge
        self._cached: tuple[Tensor, Tensor] | None = None
        """The backgrounds seen last and their feature maps."""

    @classmethod
    def load(
        cls,
        weights: str | Path = "neugrasp",
        gripper: str | Path = "panda",
        device: str | torch.device = "cpu",
        threshold: float | None = None,
        hand_check: bool = True,
        evaluator: str | Path | None = None,
    ) -> NeuGraspDetector:
        """From shipped weights by name or a weights file, and a gripper by name or file.

        Without a `threshold`, the one noted with the weights when they were judged, else the paper's. With
        `hand_check`, grasps go as deep as the reconstructed surface lets the hand; those that would meet it,
        or close on nothing, are dropped, and those that hold a rim only, where others hold more. With an
        `evaluator`, by name or file, that one judges instead, and the threshold is its own.
        Raises `InputError` where weights, gripper or threshold cannot be used.
        """
        checkpoint = load_checkpoint(weights)
        if threshold is not None and not 0 <= threshold <= 1:
            raise InputError(f"threshold {threshold}: must lie between 0 and 1")
        hand = Gripper.load(gripper)
        if evaluator is not None:
            judge = Judge.load(evaluator, gripper, checkpoint.workspace, threshold)
            return cls(checkpoint.model(), hand, SelectionConfig(threshold=HINTS), device, judge)
        if threshold is None:
            threshold = float(checkpoint.about.get("threshold", SelectionConfig.threshold))
        selection = SelectionConfig(threshold=threshold, hand=HandCheck(hand) if hand_check else None)
        return cls(checkpoint.model(), hand, selection, device)

    @torch.no_grad()
    def detect(self, views: Views) -> Detection:
        """Surface and ranked grasps, from any number of threads at once.

        Raises `InputError` where a photo misses the workspace, or the workspace is another cube than the
        network was trained for.
        """
        if views.workspace.cube != self.model.workspace.cube:
            raise InputError(
                f"the scene's workspace is {views.workspace.describe()}; these weights were trained for "
                f"{self.model.workspace.describe()}, and see nothing else"
            )
        watch = Stopwatch()
        with watch.stage("prepare"):
            inputs = prepare(views, self.model.config.image_size).to(self.device)
        with watch.stage("backgrounds"):
            background = self._backgrounds(inputs)
        with watch.stage("images"):
            scene = self.model.encode(inputs.images)
        with watch.stage("reconstruct"):
            reconstruction = self.model.reconstruct(scene, background, inputs)
        with watch.stage("grasp_head"):
            prediction = predict_grasps(
                self.model.head, reconstruction.tsdf.float().cpu().numpy(), self.device
            )
        with watch.stage("selection"):
            chosen = self._chosen(prediction)
            placed = views.workspace.world_from_workspace
            grasps = tuple(grasp.moved(placed) for grasp in chosen.grasps)
        return Detection(
            grasps,
            prediction.tsdf,
            chosen.rejected,
            chosen.best_rejected,
            watch.seconds,
            self.selection.threshold if self.judge is None else self.judge.config.threshold,
        )

    def _chosen(self, prediction: Prediction) -> Selection:
        chosen = select_grasps(prediction, self.model.workspace, self.gripper, self.selection)
        if self.judge is None:
            return chosen
        peaks = np.array([grasp.pose for grasp in chosen.grasps], np.float64).reshape(-1, 4, 4)
        return self.judge.find(prediction.tsdf, self.model.workspace, peaks)

    def _backgrounds(self, inputs: ViewTensors) -> Tensor | None:
        if not self.model.config.use_backgrounds:
            return None
        cached = self._cached  # read once: another thread may be at another cell
        if cached is None or not torch.equal(cached[0], inputs.backgrounds):
            cached = inputs.backgrounds, self.model.encode(inputs.backgrounds)
            self._cached = cached
        return cached[1]
