"""GraspNeRF as two detectors: weights that learned with TSDF and depth, and weights that learned without."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch

from neugrasp.baselines.graspnerf.config import GraspNerfConfig
from neugrasp.baselines.graspnerf.network import GraspNerf
from neugrasp.baselines.graspnerf.recipes import NETWORK
from neugrasp.detection.collision_filter import CollisionFilter
from neugrasp.detection.contract import Detection, Stopwatch
from neugrasp.detection.decode import SelectionConfig, select_grasps
from neugrasp.detection.detector import check_cube, noted_facts, threshold_of
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import DetectorSpec
from neugrasp.detection.test_time_augmentation import predict_grasps
from neugrasp.errors import InputError
from neugrasp.gripper import Gripper
from neugrasp.model.checkpoint import find_weights, load_network, notes_of
from neugrasp.model.compute import Compute
from neugrasp.model.inputs import prepare
from neugrasp.observation import Observation, with_photos

NAMES = ("graspnerf", "graspnerf-tsdf")
"""Names of the detectors, of their recipes and of their shipped weights."""


@dataclass(frozen=True)
class GraspNerfDetector:
    """Photos to surface and grasps, by the rules of `NeuGraspDetector`."""

    model: GraspNerf
    gripper: Gripper
    selection: SelectionConfig
    compute: Compute

    @torch.no_grad()
    def detect(self, seen: Observation) -> Detection:
        """Surface and ranked grasps.

        Raises `InputError` where photos are missing or miss the workspace, or the workspace is another cube
        than the network was trained for.
        """
        views = with_photos(seen)
        check_cube(views.workspace, self.model.workspace)
        watch, device = Stopwatch(), self.compute.device
        with watch.stage("prepare"):
            inputs = prepare(views, self.model.config.image_size).to(device)
        with self.compute.autocast():
            with watch.stage("images"):
                scene = self.model.encode(inputs)
            with watch.stage("reconstruct"):
                tsdf = self.model.reconstruct(scene).tsdf.float().cpu().numpy()
            with watch.stage("grasp_head"):
                prediction = predict_grasps(self.model.head, tsdf, device)
        with watch.stage("selection"):
            chosen = select_grasps(prediction, self.model.workspace, self.gripper, self.selection)
        threshold = self.selection.threshold
        return chosen.detection(
            views.workspace, self.gripper, prediction.tsdf, threshold, watch.seconds, views.source
        )


def _weights(name: str, options: DetectorOptions) -> tuple[Path, dict[str, Any]]:
    """The file of the weights, and what is noted with them. Raises `InputError` on another detector's."""
    is_usual = options.weights == DetectorOptions.weights
    try:
        path = find_weights(name if is_usual else options.weights)
    except InputError as error:
        raise InputError(f"{error}; `neugrasp train --recipe {name}` makes some") from error
    about = notes_of(path, NETWORK)
    if about.get("recipe") in {*NAMES} - {name}:
        raise InputError(f"{path}: trained as {about['recipe']}, not as {name}; give --detector")
    return path, about


def _load(name: str, options: DetectorOptions) -> GraspNerfDetector:
    path, about = _weights(name, options)
    compute, gripper = Compute.of(options.device, options.precision), Gripper.load(options.gripper)
    model = load_network(path, NETWORK, GraspNerfConfig, GraspNerf).to(compute.device)
    hand = CollisionFilter(gripper) if options.hand_check else None
    selection = SelectionConfig(threshold=threshold_of(about, options.threshold), hand=hand)
    return GraspNerfDetector(model, gripper, selection, compute)


def _facts(name: str, options: DetectorOptions) -> dict[str, Any]:
    path, about = _weights(name, options)
    workspace = load_network(path, NETWORK, GraspNerfConfig, GraspNerf).workspace
    return noted_facts(path, about, workspace, options)


def _spec(name: str) -> DetectorSpec:
    return DetectorSpec(frozenset({"image"}), partial(_load, name), partial(_facts, name))


WITHOUT, WITH_TSDF = (_spec(name) for name in NAMES)
