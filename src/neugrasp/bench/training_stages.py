"""A training step in stages."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from neugrasp.bench.counting import Kept
from neugrasp.bench.recorder import Cost, Recorder, watched
from neugrasp.bench.stages import PARTS
from neugrasp.model.network import NeuGrasp
from neugrasp.training.config import TrainConfig
from neugrasp.training.dataset import Batch
from neugrasp.training.module import TrainingModule, neugrasp_losses
from neugrasp.training.samples import Sample
from neugrasp.training.state import TrainState

FLOAT = 4
"""Bytes of a weight, a gradient or a moment."""
ADAM_PASSES = 7
"""Adam reads weights, gradients and both moments; it writes weights and moments."""
AVERAGE_PASSES = 3
"""The moving average is read with the weights, and written."""


class TrainingStep:
    """One scene, forward, backward and update, as the trainer does them."""

    def __init__(self, model: NeuGrasp, config: TrainConfig, sample: Sample):
        weights = replace(config.weights, rehearsal=0.0)
        self.config = replace(config, weights=weights, head_steps=0)
        self.batch = Batch((sample,), ())
        self.module = TrainingModule(model.train(), neugrasp_losses, self.config)
        self.learner = TrainState.of(model, self.config)
        self.weights: list[Tensor] = list(model.parameters())
        self.device = self.weights[0].device
        self.kept = 0
        """Bytes of activations that the last counted step kept for its backward pass."""

    def run(self, recorder: Recorder) -> None:
        """A step; while operations are counted, so are the activations."""
        kept = Kept(self.weights)
        num_weights = sum(weight.numel() for weight in self.weights)
        with watched(self.module.network, PARTS, recorder):
            if recorder.counter:
                with kept.watching():
                    loss = self._forward(recorder)
                self.kept = kept.num_bytes
            else:
                loss = self._forward(recorder)
        with recorder.stage("backward"):
            loss.backward()
        with recorder.stage("optimiser"):
            self.learner.update(self.config.optimiser.gradient_clip)
        if recorder.counter:
            recorder.note("backward", Cost(num_bytes=kept.num_bytes + 2 * FLOAT * num_weights))
            passes = ADAM_PASSES + AVERAGE_PASSES
            recorder.note("optimiser", Cost(num_bytes=passes * FLOAT * num_weights))

    def _forward(self, recorder: Recorder) -> Tensor:
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.config.bfloat16):
            losses = recorder.call("losses", None, self.module, self.batch, self.config.steps)
        loss: Tensor = losses["loss"]
        return loss
