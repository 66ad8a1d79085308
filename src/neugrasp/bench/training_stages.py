"""A training step of the product and of the plain reference, in the same stages."""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor, nn

from neugrasp.bench.counting import Kept
from neugrasp.bench.recorder import Cost, Recorder, watched
from neugrasp.bench.stages import PARTS
from neugrasp.model.network import NeuGrasp
from neugrasp.training.config import TrainConfig
from neugrasp.training.samples import Sample
from neugrasp.training.state import Learner
from neugrasp.training.step import joint_losses, total

FLOAT = 4
"""Bytes of a weight, a gradient or a moment."""
ADAM_PASSES = 7
"""Adam reads weights, gradients and both moments; it writes weights and moments."""
AVERAGE_PASSES = 3
"""The moving average is read with the weights, and written."""


class Trainee(Protocol):
    """A network that learns."""

    @property
    def network(self) -> nn.Module:
        """What learns."""
        ...

    def loss(self, sample: Sample, generator: torch.Generator) -> Tensor:
        """What is to become less."""
        ...

    def update(self) -> None:
        """One step of the optimiser, with all that belongs to it."""
        ...


class ProductTrainer:
    """The trainer's step."""

    def __init__(self, model: NeuGrasp, config: TrainConfig):
        self.network = model.train()
        self.config = config
        self.learner = Learner.of(model, config)

    def loss(self, sample: Sample, generator: torch.Generator) -> Tensor:
        sharpness = self.config.sharpness_at(self.config.steps)
        device = next(self.network.parameters()).device
        with torch.autocast(device.type, torch.bfloat16, enabled=self.config.bfloat16):
            return total(joint_losses(self.network, sample, self.config, sharpness, generator), self.config)

    def update(self) -> None:
        self.learner.update(self.config.gradient_clip)


class TrainingStep:
    """One scene, forward, backward and update."""

    def __init__(self, trainee: Trainee, sample: Sample, seed: int):
        self.trainee, self.sample = trainee, sample
        self.generator = torch.Generator().manual_seed(seed)
        self.weights: list[Tensor] = list(trainee.network.parameters())
        self.device = self.weights[0].device
        self.kept = 0
        """Bytes of activations that the last counted step kept for its backward pass."""

    def run(self, recorder: Recorder) -> None:
        """A step; while operations are counted, so are the activations."""
        kept = Kept(self.weights)
        num_weights = sum(weight.numel() for weight in self.weights)
        with watched(self.trainee.network, PARTS, recorder):
            if recorder.counter:
                with kept.watching():
                    loss = self._forward(recorder)
                self.kept = kept.num_bytes
            else:
                loss = self._forward(recorder)
        with recorder.stage("backward"):
            loss.backward()
        with recorder.stage("optimiser"):
            self.trainee.update()
        if recorder.counter:
            recorder.note("backward", Cost(num_bytes=kept.num_bytes + 2 * FLOAT * num_weights))
            passes = ADAM_PASSES + AVERAGE_PASSES
            recorder.note("optimiser", Cost(num_bytes=passes * FLOAT * num_weights))

    def _forward(self, recorder: Recorder) -> Tensor:
        loss: Tensor = recorder.call("losses", None, self.trainee.loss, self.sample, self.generator)
        return loss
