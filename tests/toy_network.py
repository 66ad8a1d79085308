"""A network that is not of the package: what changed in the photos, blurred, and one learned number."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, nn

from neugrasp.detection.contract import Detection
from neugrasp.detection.registry import PHOTOS, DetectorSpec
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.checkpoint import load_network
from neugrasp.model.config import NetworkConfig
from neugrasp.observation import Observation
from neugrasp.training.networks import NetworkSpec
from toy_detector import Downwards

NAME = "toy_network:NETWORK"


@dataclass(frozen=True, kw_only=True)
class ToyConfig(NetworkConfig):
    image_size: int = 32
    gain: float = 1.0


class Toy(nn.Module):
    def __init__(self, config: ToyConfig, workspace: Workspace):
        super().__init__()
        self.config, self.workspace = config, workspace
        self.height = nn.Parameter(torch.tensor(0.1))

    def forward(self, change: Tensor) -> Tensor:
        """One signed distance for the whole cube."""
        return self.config.gain * self.height - change.mean()


def losses(network, batch, config, step, generator):
    scenes = [(s.inputs.views.images - s.inputs.views.backgrounds, s.truth.tsdf) for s in batch.samples]
    return {"loss": torch.stack([(network(change) - tsdf.mean()) ** 2 for change, tsdf in scenes]).mean()}


NETWORK = NetworkSpec(Toy, losses, lambda network, *_: {"height": network.height.item()})


class ToyDetector(Downwards):
    def __init__(self, weights: str):
        self.network = load_network(Path(weights), NAME, ToyConfig, Toy)

    def detect(self, seen: Observation) -> Detection:
        """The toy detector's grasp, as long as something was learned."""
        assert self.network.height != 0.1
        return super().detect(seen)


DETECTOR = DetectorSpec(PHOTOS, lambda options: ToyDetector(options.weights))
