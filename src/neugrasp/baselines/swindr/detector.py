"""SwinDR-VGN as a detector: photos and stereo depth -> restored depth -> VGN."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from neugrasp.baselines.swindr.config import SwinConfig
from neugrasp.baselines.swindr.network import SwinDR
from neugrasp.baselines.swindr.recipes import NETWORK
from neugrasp.baselines.vgn import SPEC as VGN
from neugrasp.detection.contract import Detection, Detector, Stopwatch
from neugrasp.detection.detector import trained_facts
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import DetectorSpec, weights_facts
from neugrasp.errors import InputError
from neugrasp.geometry.pose import inverse
from neugrasp.model.checkpoint import find_weights, load_network, notes_of
from neugrasp.model.compute import Compute
from neugrasp.model.inputs import crop_view, to_tensor
from neugrasp.observation import Depth, DepthView, DepthViews, Observation, View, with_depth, with_photos
from neugrasp.training.prepared import depth_through


@dataclass(frozen=True)
class SwinDrDetector:
    """Depth images made whole, then VGN."""

    network: SwinDR
    vgn: Detector[Observation]
    compute: Compute

    @torch.no_grad()
    def detect(self, seen: Observation) -> Detection:
        """Ranked grasps in the user's world. Raises `InputError` where photos or depth images are missing."""
        watch = Stopwatch()
        with watch.stage("restore"):
            views = self.restore(seen)
        found = self.vgn.detect(views)
        return replace(found, timing_s={**watch.seconds, **found.timing_s})

    @torch.no_grad()
    def restore(self, seen: Observation) -> DepthViews:
        """The restored depth of every view, cropped to the workspace; 0 beyond the network's scale."""
        config, workspace = self.network.config, seen.workspace
        moved = inverse(workspace.world_from_workspace)
        photos, depths = [], []
        for photo, depth in zip(with_photos(seen).frames, with_depth(seen).frames, strict=True):
            camera = photo.camera.moved(moved)
            alone = View(photo.camera, photo.image, photo.background, name=photo.name)
            cut = crop_view(alone, camera, workspace.photo_box(camera), config.image_size)
            photos.append(cut)
            depths.append(torch.from_numpy(depth_through(cut.camera, camera, depth.depth)).float())
        device = self.compute.device
        images = to_tensor([photo.image for photo in photos]).to(device)
        with self.compute.autocast():
            found = self.network(images, torch.stack(depths).to(device)).depth.float().cpu().numpy()
        frames = tuple(self._frame(photo, depth, seen) for photo, depth in zip(photos, found, strict=True))
        return DepthViews(frames, workspace, seen.source)

    def _frame(self, photo: View, depth: Depth, seen: Observation) -> DepthView:
        config = self.network.config
        inside = photo.camera.measured_pixels() & (depth > config.nearest) & (depth < config.farthest)
        camera = photo.camera.moved(seen.workspace.world_from_workspace)
        return DepthView(camera, depth=(depth * inside).astype("f4"), name=photo.name)


def restorer_file(name_or_path: str) -> Path:
    """The weights of a restorer, by name or file. Raises `InputError` where there are none."""
    try:
        return find_weights(name_or_path)
    except InputError as error:
        raise InputError(f"{error}; `neugrasp train --recipe swindr` makes some") from error


def _load(options: DetectorOptions) -> SwinDrDetector:
    compute = Compute.of(options.device, options.precision)
    network = load_network(restorer_file(options.restorer), NETWORK, SwinConfig, SwinDR)
    return SwinDrDetector(network.to(compute.device), VGN.load(options), compute)


def _facts(options: DetectorOptions) -> dict[str, Any]:
    path = restorer_file(options.restorer)
    told, trained = weights_facts(path, 0.0), trained_facts(notes_of(path, NETWORK))
    restorer = {"restorer": told["weights"], "restorer_sha256": told["weights_sha256"]}
    return {**VGN.facts(options), **restorer, "restorer_trained": trained}


SPEC = DetectorSpec(frozenset({"image", "depth"}), _load, _facts)
