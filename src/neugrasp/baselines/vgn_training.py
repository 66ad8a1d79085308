"""VGN on our own physics: the grasp head alone, on grids fused from 1 to 6 noise-free views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor, nn

from neugrasp.geometry.workspace import USUAL, Workspace
from neugrasp.model.config import ModelConfig, NetworkConfig
from neugrasp.model.grasp_head import GraspHead, GraspVolume
from neugrasp.training import recipes
from neugrasp.training.config import TrainConfig
from neugrasp.training.dataset import Batch
from neugrasp.training.losses import grasp_loss
from neugrasp.training.module import Losses
from neugrasp.training.networks import HeldOut, NetworkSpec
from neugrasp.training.samples import Truth
from neugrasp.training.validation import Scores, grasp_scores

NAME = "vgn"
"""Name of the network, its recipe, its detector and its shipped weights."""


@dataclass(frozen=True, kw_only=True)
class VgnConfig(NetworkConfig):
    """VGN's sizes."""

    head_channels: tuple[int, int, int] = (16, 32, 64)


class Vgn(nn.Module):
    """The grasp head as a network of its own."""

    def __init__(self, config: VgnConfig, workspace: Workspace | None = None):
        super().__init__()
        self.config = config
        self.workspace = workspace or USUAL
        self.head = GraspHead(ModelConfig(head_channels=config.head_channels))

    def forward(self, grids: Tensor) -> GraspVolume:
        """From grids (b, r, r, r) as `vgn_grid` makes them."""
        volume: GraspVolume = self.head(grids)
        return volume


def vgn_losses(
    network: Vgn, batch: Batch, _config: TrainConfig, _step: int, generator: torch.Generator
) -> Losses:
    """VGN's loss on one of the fused grids of each scene."""
    grids = torch.stack([_any_of(truth.needed("fused"), generator) for truth in batch.truths])
    loss = grasp_loss(network(grids), [truth.labels for truth in batch.truths])
    return {"loss": loss, "grasp": loss}


def _any_of(grids: Tensor, generator: torch.Generator) -> Tensor:
    return grids[int(torch.randint(len(grids), (), generator=generator))]


def judge_vgn(
    network: Vgn, held_out: HeldOut, _config: TrainConfig, _step: int, _folder: Path
) -> dict[str, float]:
    """AUC and rotation error of the grasps on every fused grid of the held-out scenes."""
    return _judged(network, held_out.truths)


@torch.no_grad()
def _judged(network: Vgn, truths: Sequence[Truth]) -> dict[str, float]:
    scores = Scores()
    device = next(network.parameters()).device
    for truth in truths:
        for grid in truth.needed("fused").to(device):
            scores.add(**grasp_scores(network(grid.unsqueeze(0)), truth.labels))
    return scores.means()


def vgn() -> TrainConfig:
    """As long as our own heads learn on true grids; scenes without photos will do."""
    return replace(recipes.head_only(), network=NAME, model=VgnConfig())


NETWORK = NetworkSpec(Vgn, vgn_losses, judge_vgn, compares=False)
