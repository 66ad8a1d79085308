"""A network that is not of the package, and a detector that holds it: one learned number."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import nn

from neugrasp.detection.registry import PHOTOS, DetectorSpec
from neugrasp.model.checkpoint import load_network
from neugrasp.model.config import NetworkConfig
from neugrasp.training.config import TrainConfig
from neugrasp.training.networks import NetworkSpec
from toy_detector import Downwards


@dataclass(frozen=True, kw_only=True)
class ToyConfig(NetworkConfig):
    gain: float = 1.0


class Toy(nn.Module):
    def __init__(self, config, workspace):
        super().__init__()
        self.config, self.workspace = config, workspace
        self.height = nn.Parameter(torch.tensor(0.1))


def losses(network, batch, config, step, generator):
    means = [sample.truth.tsdf.mean() for sample in batch.samples]
    return {"loss": (config.model.gain * network.height - torch.stack(means)).square().mean()}


NAME = "toy_network:NETWORK"
NETWORK = NetworkSpec(Toy, losses, lambda network, *_: {"height": network.height.item()})


def recipe():
    return TrainConfig(network=NAME, model=ToyConfig())


class ToyDetector(Downwards):
    def __init__(self, options):
        load_network(Path(options.weights), NAME, ToyConfig, Toy)


DETECTOR = DetectorSpec(PHOTOS, ToyDetector)
