"""VGN (Breyer et al., CoRL 2020): depth images -> fused grid -> grasps, with public weights (method.md C).

The network is the grasp head of this project, which was taken from VGN: only the input differs, a grid in
[0, 1] that is 0 both where nothing was seen and far in front of every surface.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from neugrasp.data.npz import reason_of
from neugrasp.detection.contract import Detection, Stopwatch
from neugrasp.detection.decode import Prediction, Selection, SelectionConfig, select_grasps
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import DEPTH, DetectorSpec, weights_facts
from neugrasp.errors import InputError
from neugrasp.geometry.fusion import Grid, Tsdf, fuse, vgn_grid
from neugrasp.geometry.pose import inverse, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.model.config import ModelConfig
from neugrasp.model.grasp_head import GraspHead
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


def load_vgn_head(path: Path) -> GraspHead:
    """The network with the weights of a public checkpoint, 18 tensors. Raises `InputError`."""
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


@torch.no_grad()
def vgn_selection(
    head: GraspHead, tsdf: Tsdf, workspace: Workspace, gripper: Gripper, config: SelectionConfig
) -> tuple[Selection, Grid]:
    """Grasps in the workspace frame, and VGN's own grid on the scale from -1 to 1.

    Where a voxel is: VGN fuses depth with voxel i centred at (i + 0.5) voxel sizes, as here, but stores a
    label at index round(position / voxel size) and reads index i as the position i * voxel size. Grasps of
    its checkpoint are therefore moved back by half a voxel along each axis against this project's own.
    """
    grid = vgn_grid(tsdf)
    volume = head(torch.from_numpy(grid).unsqueeze(0))
    scaled: Grid = (2 * grid - 1).astype(np.float32)
    prediction = Prediction(
        scaled, volume.quality[0].numpy(), volume.rotation[0].numpy(), volume.width[0].numpy()
    )
    chosen = select_grasps(prediction, workspace, gripper, config)
    shift = rigid(translation=np.full(3, -workspace.voxel_size / 2))
    moved = tuple(grasp.moved(shift) for grasp in chosen.grasps)
    return Selection(moved, chosen.rejected, chosen.best_rejected), scaled


class VgnDetector:
    """Depth images in, grasps out."""

    def __init__(self, head: GraspHead, gripper: Gripper, threshold: float = SelectionConfig().threshold):
        self._head = head
        self._gripper = gripper
        self._config = SelectionConfig(threshold=threshold, inside=INSIDE)

    def detect(self, seen: Observation) -> Detection:
        """Ranked grasps in the user's world. Raises `InputError` where depth images are missing."""
        views = with_depth(seen)
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


def is_vgn(weights: str) -> bool:
    """Whether the name is that of a public checkpoint."""
    return Path(weights).suffix == ".pth"


def vgn_facts(options: DetectorOptions) -> dict[str, Any]:
    """Name, hash and threshold of the checkpoint."""
    threshold = SelectionConfig.threshold if options.threshold is None else options.threshold
    return weights_facts(_file(options), threshold)


def _load(options: DetectorOptions) -> VgnDetector:
    threshold = SelectionConfig.threshold if options.threshold is None else options.threshold
    return VgnDetector(load_vgn_head(_file(options)), Gripper.load(options.gripper), threshold)


def _file(options: DetectorOptions) -> Path:
    if not is_vgn(options.weights):
        raise InputError(
            f"--weights {options.weights}: vgn needs the public checkpoint vgn_conv.pth of "
            "github.com/ethz-asl/vgn"
        )
    return Path(options.weights)


SPEC = DetectorSpec(DEPTH, _load, vgn_facts)
