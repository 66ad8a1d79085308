"""A network that is not of the package, and a detector that holds it: one learned number."""

from pathlib import Path

import torch

from neugrasp.detection.registry import PHOTOS, DetectorSpec
from neugrasp.model.checkpoint import load_network
from neugrasp.model.config import NetworkConfig
from neugrasp.training.config import TrainConfig
from neugrasp.training.networks import NetworkSpec
from toy_detector import Downwards


class Toy(torch.nn.Module):
    def __init__(self, config, workspace):
        super().__init__()
        self.config, self.workspace = config, workspace
        self.height = torch.nn.Parameter(torch.tensor(0.1))


def losses(network, batch, config, step, generator):
    return {"loss": (network.height - batch.samples[0].truth.tsdf.mean()).square()}


NAME = "toy_network:NETWORK"
NETWORK = NetworkSpec(Toy, losses, lambda network, *_: {"height": network.height.item()})


def recipe():
    return TrainConfig(network=NAME, model=NetworkConfig())


class ToyDetector(Downwards):
    def __init__(self, options):
        load_network(Path(options.weights), NAME, NetworkConfig, Toy)


DETECTOR = DetectorSpec(PHOTOS, ToyDetector)
