"""NeuGrasp as a detector: photos and photos of the empty table in, surface and grasps out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from neugrasp.detection.background_memory import CELLS, BackgroundMemory
from neugrasp.detection.collision_filter import CollisionFilter
from neugrasp.detection.contract import Detection, Stopwatch
from neugrasp.detection.decode import Prediction, Selection, SelectionConfig, select_grasps
from neugrasp.detection.judge import Judge, judge_facts
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import PHOTOS, DetectorSpec, weights_facts
from neugrasp.detection.test_time_augmentation import predict_grasps
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasps
from neugrasp.gripper import Gripper
from neugrasp.model.checkpoint import find_weights, load_checkpoint
from neugrasp.model.compute import Compute
from neugrasp.model.evaluator_file import shipped_evaluators
from neugrasp.model.inputs import ViewTensors, prepare
from neugrasp.model.network import NeuGrasp
from neugrasp.observation import Observation, with_backgrounds

HINTS = 0.3
"""Smoothed quality from which the head's peaks are judged beside what is drawn from the surface."""


class NeuGraspDetector:
    """Photos to grasps with the network. Features of the backgrounds of some cells are kept and reused.

    With a `judge` the head only proposes; what is a grasp, and how sure, the evaluator says.

    One detector serves many threads, and many cells: those seen last, up to `cells` of them, are remembered.
    """

    def __init__(
        self,
        model: NeuGrasp,
        gripper: Gripper,
        selection: SelectionConfig | None = None,
        device: str | torch.device = "cpu",
        precision: str = "float32",
        judge: Judge | None = None,
        cells: int = CELLS,
    ):
        self.compute = Compute.of(device, precision)
        self.model = model.to(self.compute.device).eval()
        self.gripper = gripper
        self.selection = selection or SelectionConfig()
        self.judge = judge
        self.memory = BackgroundMemory(cells)

    @classmethod
    def load(
        cls,
        weights: str | Path = "neugrasp",
        gripper: str | Path = "panda",
        device: str | torch.device = "cpu",
        threshold: float | None = None,
        hand_check: bool = True,
        precision: str = "float32",
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
            selection = SelectionConfig(threshold=HINTS)
            return cls(checkpoint.model(), hand, selection, device, precision, judge)
        threshold = threshold_of(checkpoint.about, threshold)
        selection = SelectionConfig(threshold=threshold, hand=CollisionFilter(hand) if hand_check else None)
        return cls(checkpoint.model(), hand, selection, device, precision)

    @classmethod
    def of(cls, options: DetectorOptions, evaluator: str | None = None) -> NeuGraspDetector:
        """As `load`, from what a command says; its evaluator is not asked unless it is given."""
        return cls.load(
            options.weights,
            options.gripper,
            options.device,
            threshold=options.threshold,
            hand_check=options.hand_check,
            precision=options.precision,
            evaluator=evaluator,
        )

    @classmethod
    def judged(cls, options: DetectorOptions) -> NeuGraspDetector:
        """As `of`, with the evaluator of the options."""
        return cls.of(options, options.evaluator)

    def __repr__(self) -> str:
        device = self.compute.device
        return f"NeuGraspDetector({self.gripper.name}, threshold {self.threshold:g}, {device})"

    @property
    def threshold(self) -> float:
        """The score below which nothing is a grasp."""
        return self.selection.threshold if self.judge is None else self.judge.config.threshold

    @torch.no_grad()
    def detect(self, seen: Observation) -> Detection:
        """Surface and ranked grasps, from any number of threads at once.

        Raises `InputError` where a photo or a background is missing, a photo misses the workspace, or the
        workspace is another cube than the network was trained for.
        """
        views = with_backgrounds(seen)
        check_cube(views.workspace, self.model.workspace)
        watch, device = Stopwatch(), self.compute.device
        with watch.stage("prepare"):
            inputs = prepare(views, self.model.config.image_size).to(device)
        with self.compute.autocast():
            with watch.stage("backgrounds"):
                background = self._backgrounds(inputs)
            with watch.stage("images"):
                scene = self.model.encode(inputs.images)
            with watch.stage("reconstruct"):
                reconstruction = self.model.reconstruct(scene, background, inputs)
            with watch.stage("grasp_head"):
                tsdf = reconstruction.tsdf.float().cpu().numpy()
                prediction = predict_grasps(self.model.head, tsdf, device)
        with watch.stage("selection"):
            chosen = self._chosen(prediction)
        return chosen.detection(
            views.workspace, self.gripper, prediction.tsdf, self.threshold, watch.seconds, views.source
        )

    @torch.no_grad()
    def remember(self, seen: Observation) -> None:
        """Makes the features of the backgrounds, so that the first `detect` at this cell finds them.

        The photos do not matter. Raises `InputError` as `detect` does.
        """
        inputs = prepare(with_backgrounds(seen), self.model.config.image_size).to(self.compute.device)
        with self.compute.autocast():
            self._backgrounds(inputs)

    def _chosen(self, prediction: Prediction) -> Selection:
        chosen = select_grasps(prediction, self.model.workspace, self.gripper, self.selection)
        if self.judge is None:
            return chosen
        peaks = Grasps.of(chosen.grasps).poses
        return self.judge.find(prediction.tsdf, self.model.workspace, peaks)

    def _backgrounds(self, inputs: ViewTensors) -> Tensor | None:
        if not self.model.config.use_backgrounds:
            return None
        return self.memory.maps(inputs.backgrounds, self.model.encode)


def check_cube(workspace: Workspace, trained: Workspace) -> None:
    """Raises `InputError` where a scene's cube is not the one that weights were trained for."""
    if workspace.cube != trained.cube:
        raise InputError(
            f"the scene's workspace is {workspace.describe()}; these weights were trained for "
            f"{trained.describe()}, and see nothing else"
        )


def threshold_of(about: Mapping[str, Any], threshold: float | None) -> float:
    """The quality from which a grasp is one: as given, else as noted with the weights, else the paper's."""
    if threshold is not None:
        return threshold
    return float(about.get("threshold", SelectionConfig.threshold))


def facts_of(options: DetectorOptions) -> dict[str, Any]:
    """Name, hash and threshold of the weights, how they were trained as far as they know, and whether the
    hand was checked."""
    checkpoint = load_checkpoint(options.weights)
    return noted_facts(find_weights(options.weights), checkpoint.about, checkpoint.workspace, options)


def trained_facts(about: Mapping[str, Any]) -> dict[str, Any]:
    """How weights were trained, of what was noted with them."""
    return {name: about[name] for name in ("recipe", "steps", "scenes") if name in about}


def noted_facts(
    path: Path, about: Mapping[str, Any], workspace: Workspace, options: DetectorOptions
) -> dict[str, Any]:
    """The same of a weights file of any network."""
    file = weights_facts(path, threshold_of(about, options.threshold))
    cube = workspace.unusual()
    asked = {"workspace": cube} if cube else {}
    return {**file, "trained": trained_facts(about), "hand_check": options.hand_check, **asked}


def _judged_facts(options: DetectorOptions) -> dict[str, Any]:
    workspace = load_checkpoint(options.weights).workspace
    facts = facts_of(options) | judge_facts(options, workspace)
    return {name: fact for name, fact in facts.items() if name != "hand_check"}


SPEC = DetectorSpec(PHOTOS, NeuGraspDetector.of, facts_of)
JUDGED = DetectorSpec(PHOTOS, NeuGraspDetector.judged, _judged_facts)
"""The same surface; an evaluator of grasps in place of the head's scores and the rules."""


def _asked(options: DetectorOptions) -> DetectorSpec:
    known = options.weights in shipped_evaluators() or options.evaluator != DetectorOptions.evaluator
    return JUDGED if known and options.hand_check else SPEC


AUTO = DetectorSpec(
    PHOTOS, lambda options: _asked(options).load(options), lambda options: _asked(options).facts(options)
)
"""With an evaluator where one knows the surfaces of the weights or is given; else, and where the hand is not
to be checked, head and rules."""
