"""RGBGrasp-GT as a detector: photos and exact depth -> radiance field -> rendered depth -> VGN."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch

from neugrasp.baselines.nerf.fit import FitConfig, fitted, pixels_of, rendered_depth
from neugrasp.baselines.vgn import SPEC as VGN
from neugrasp.detection.contract import Detection, Detector, Stopwatch
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import DetectorSpec
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import from_rotation_vector, inverse, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.compute import Compute
from neugrasp.observation import DepthView, DepthViews, Observation, with_depth

SMALLER = 2
"""Pixels of a photo for each of the rendered depth: still finer than a voxel."""


class NerfDetector:
    """A new field for every observation."""

    def __init__(
        self,
        vgn: Detector[Observation],
        device: torch.device,
        config: FitConfig | None = None,
        seed: int = 0,
        turns: tuple[float, ...] = (0.0,),
    ):
        """`turns`: from where depth is rendered, as angles in radians by which the cameras are turned about
        the vertical through the middle of the cube; 0 is where they stand."""
        self._vgn, self._device, self._seed, self._turns = vgn, device, seed, turns
        self._config = config or FitConfig()

    def detect(self, seen: Observation) -> Detection:
        """Ranked grasps in the user's world. Raises `InputError` where photos or depth images are missing,
        `Diverged` where the field learned nothing."""
        here = _in_workspace_frame(seen)
        watch = Stopwatch()
        with watch.stage("fit"):
            field = fitted(pixels_of(here), here.workspace, self._config, self._device, self._seed)
        with watch.stage("render"):
            cameras = [
                _smaller(_turned(frame.camera, here.workspace, turn))
                for turn in self._turns
                for frame in here.frames
            ]
            depths = [rendered_depth(field, camera, here.workspace) for camera in cameras]
        placed = seen.workspace.world_from_workspace
        views = tuple(
            DepthView(camera.moved(placed), depth=depth)
            for camera, depth in zip(cameras, depths, strict=True)
        )
        found = self._vgn.detect(DepthViews(views, seen.workspace, seen.source))
        return replace(found, timing_s={**watch.seconds, **found.timing_s})


def _in_workspace_frame(seen: Observation) -> Observation:
    if "image" not in seen.channels:
        raise InputError(f"{seen.source or 'the observation'}: has no photo; this detector needs it")
    with_depth(seen)
    return seen.in_workspace_frame()


def _turned(camera: Camera, workspace: Workspace, angle: float) -> Camera:
    middle = rigid(translation=workspace.centre)
    return camera.moved(middle @ from_rotation_vector((0.0, 0.0, angle)) @ inverse(middle))


def _smaller(camera: Camera) -> Camera:
    whole = (-0.5, -0.5, camera.width - 0.5, camera.height - 0.5)
    return camera.cropped_and_resized(whole, -(-camera.width // SMALLER), -(-camera.height // SMALLER))


def _load(options: DetectorOptions) -> NerfDetector:
    device = Compute.of(options.device).device
    return NerfDetector(VGN.load(options), device, seed=options.seed)


def _facts(options: DetectorOptions) -> dict[str, Any]:
    config = FitConfig()
    return {**VGN.facts(options), "fit": {"steps": config.steps, "rays": config.rays}}


SPEC = DetectorSpec(frozenset({"image", "depth"}), _load, _facts)
