"""VGN (Breyer et al., CoRL 2020): depth images -> fused grid -> grasps, with weights of ours or public ones.

The network is the grasp head of this project, which was taken from VGN: only the input differs, a grid in
[0, 1] that is 0 both where nothing was seen and far in front of every surface.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from neugrasp.baselines.vgn_training import NAME, Vgn, VgnConfig
from neugrasp.data.npz import reason_of
from neugrasp.detection.contract import Detection, Stopwatch
from neugrasp.detection.decode import Prediction, Selection, SelectionConfig, select_grasps, stored
from neugrasp.detection.detector import check_cube, noted_facts, threshold_of
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import DEPTH, DetectorSpec, weights_facts
from neugrasp.errors import InputError, WeightsError, told_as
from neugrasp.geometry.fusion import Grid, Tsdf, fuse, vgn_grid
from neugrasp.geometry.pose import inverse, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.model.checkpoint import find_weights, load_network, notes_of
from neugrasp.model.config import ModelConfig
from neugrasp.model.grasp_head import GraspHead, GraspVolume
from neugrasp.model.weights_file import FLOATS
from neugrasp.observation import Observation, with_depth

INSIDE = (2e-3 - 1, 0.0)
"""VGN's 1e-3 to 0.5 on the grid from 0 to 1, on the scale from -1 to 1."""
PUBLIC_NAMES = {
    "encoder.conv1": "encoder.0",
    "encoder.conv2": "encoder.1",
    "encoder.conv3": "encoder.2",
    "decoder.conv1": "decoder.0",
    "decoder.conv2": "decoder.1",
    "decoder.conv3": "decoder.2",
    "conv_qual": "quality",
    "conv_rot": "rotation",
    "conv_width": "width",
}
"""Layers of the public checkpoint and of `GraspHead`."""


@told_as(WeightsError)
def load_vgn_head(path: Path) -> GraspHead:
    """The network with the weights of a public checkpoint, 18 tensors. Raises `WeightsError`."""
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    # The unpickler raises whatever a foreign byte leads it to.
    except Exception as error:
        raise InputError(f"{path}: not readable as VGN weights ({reason_of(error)})") from error
    head = GraspHead(ModelConfig())
    head.load_state_dict(_renamed(state, head, path))
    return head.eval()


def _renamed(state: object, head: GraspHead, path: Path) -> dict[str, Tensor]:
    wanted = head.state_dict()
    expected = {f"{name}.{part}" for name in PUBLIC_NAMES for part in ("weight", "bias")}
    if not isinstance(state, Mapping) or set(state) != expected:
        raise InputError(
            f"{path}: not VGN weights; they are a dict of {len(expected)} tensors, conv_qual.*, ..."
        )
    renamed = {}
    for key, tensor in state.items():
        layer, part = key.rsplit(".", 1)
        own = f"{PUBLIC_NAMES[layer]}.{part}"
        if not isinstance(tensor, Tensor) or tensor.dtype not in FLOATS:
            raise InputError(f"{path}: {key} is no tensor of floating numbers")
        if tensor.shape != wanted[own].shape or not torch.isfinite(tensor.float()).all():
            raise InputError(f"{path}: {key} has shape {tuple(tensor.shape)} or is not finite")
        renamed[own] = tensor
    return renamed


@dataclass(frozen=True)
class VgnHead:
    """The network, and where its labels lay.

    VGN fuses depth with voxel i centred at (i + 0.5) voxel sizes, as here, but stores a label at index
    round(position / voxel size) and reads index i as the position i * voxel size. Grasps of its public
    checkpoint are therefore moved back by half a voxel along each axis against those of weights of ours.
    """

    network: Callable[[Tensor], GraspVolume]
    is_public: bool
    threshold: float = SelectionConfig.threshold
    """Threshold of scores, as noted with the weights."""
    workspace: Workspace | None = None
    """The cube that weights of ours were trained for."""

    @classmethod
    def load(cls, weights: str) -> VgnHead:
        """A public checkpoint from its file, or weights of ours by name or file; the shipped ones where
        nothing is said. Raises `InputError` where there are none, or they are another network's."""
        if is_public(weights):
            return cls(load_vgn_head(Path(weights)), is_public=True)
        path = own_weights(weights)
        network = load_network(path, NAME, VgnConfig, Vgn)
        return cls(network, False, threshold_of(notes_of(path, NAME), None), network.workspace)


@torch.no_grad()
def vgn_selection(
    head: VgnHead, tsdf: Tsdf, workspace: Workspace, gripper: Gripper, config: SelectionConfig
) -> tuple[Selection, Grid]:
    """Grasps in the workspace frame, and VGN's own grid on the scale from -1 to 1."""
    grid = vgn_grid(tsdf)
    volume = head.network(torch.from_numpy(grid).unsqueeze(0))
    scaled: Grid = (2 * grid - 1).astype(np.float32)
    rotations = stored(volume.rotation[0].numpy())
    prediction = Prediction(scaled, volume.quality[0].numpy(), volume.width[0].numpy(), rotations)
    chosen = select_grasps(prediction, workspace, gripper, config)
    if not head.is_public:
        return chosen, scaled
    shift = rigid(translation=np.full(3, -workspace.voxel_size / 2))
    moved = tuple(grasp.moved(shift) for grasp in chosen.grasps)
    return Selection(moved, chosen.rejected, chosen.best_rejected), scaled


class VgnDetector:
    """Depth images in, grasps out."""

    def __init__(self, head: VgnHead, gripper: Gripper, threshold: float | None = None):
        self._head = head
        self._gripper = gripper
        self._config = selection_of(head, threshold)

    def detect(self, seen: Observation) -> Detection:
        """Ranked grasps in the user's world. Raises `InputError` where depth images are missing, or the
        workspace is another cube than weights of ours were trained for."""
        views = with_depth(seen)
        if self._head.workspace is not None:
            check_cube(views.workspace, self._head.workspace)
        watch, workspace = Stopwatch(), views.workspace
        placed = workspace.world_from_workspace
        with watch.stage("fuse"):
            cameras = [view.camera.moved(inverse(placed)) for view in views.frames]
            tsdf = fuse([view.depth for view in views.frames], cameras, workspace)
        with watch.stage("grasp_head"):
            chosen, grid = vgn_selection(self._head, tsdf, workspace, self._gripper, self._config)
        return chosen.detection(
            workspace, self._gripper, grid, self._config.threshold, watch.seconds, views.source
        )


def selection_of(head: VgnHead, threshold: float | None) -> SelectionConfig:
    """VGN's rules; without a threshold, with that of the weights."""
    return SelectionConfig(threshold=head.threshold if threshold is None else threshold, inside=INSIDE)


def is_public(weights: str) -> bool:
    """Whether the name is that of a public checkpoint."""
    return Path(weights).suffix == ".pth"


def own_weights(weights: str) -> Path:
    """The file of weights of ours. Raises `InputError` where there is none."""
    try:
        return find_weights(NAME if weights == DetectorOptions.weights else weights)
    except InputError as error:
        raise InputError(
            f"{error}; `neugrasp train --recipe vgn` makes some, and vgn_conv.pth of github.com/ethz-asl/vgn "
            "will do"
        ) from error


def vgn_facts(options: DetectorOptions) -> dict[str, Any]:
    """Name, hash and threshold of the weights, and how ours were trained."""
    if is_public(options.weights):
        threshold = SelectionConfig.threshold if options.threshold is None else options.threshold
        return weights_facts(Path(options.weights), threshold)
    path = own_weights(options.weights)
    workspace = load_network(path, NAME, VgnConfig, Vgn).workspace
    facts = noted_facts(path, notes_of(path, NAME), workspace, options)
    return {name: fact for name, fact in facts.items() if name != "hand_check"}


def _load(options: DetectorOptions) -> VgnDetector:
    return VgnDetector(VgnHead.load(options.weights), Gripper.load(options.gripper), options.threshold)


SPEC = DetectorSpec(DEPTH, _load, vgn_facts)
