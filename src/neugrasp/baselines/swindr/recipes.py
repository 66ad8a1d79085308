"""Courses of training of SwinDR."""

from __future__ import annotations

from dataclasses import replace

from neugrasp.baselines.swindr.config import SwinConfig
from neugrasp.training.config import LossWeights, Optimiser, TrainConfig

NETWORK = "swindr"


def swindr() -> TrainConfig:
    """From photos and stereo depth of `neugrasp generate --stereo`, all views of a scene in each step."""
    return TrainConfig(
        network=NETWORK,
        # Pixels of 3 mm, less than half a voxel, for a quarter of the time that 256 would take.
        model=SwinConfig(image_size=128),
        weights=LossWeights(photometric=0, eikonal=0, grasp=0, carving=0, grid_carving=0, depth=1.0),
        steps=4_000,
        optimiser=Optimiser(learning_rate=1e-3, schedule="cosine", average=0.99),
        validate_every=250,
        bfloat16=True,
    )


def tiny() -> TrainConfig:
    """A dozen steps on a laptop's CPU: what the tests run."""
    model = SwinConfig(image_size=64, width=4, depths=(1, 2, 1, 1), heads=(1, 2, 2, 2), decoder_width=4)
    return replace(
        swindr(),
        model=model,
        bfloat16=False,
        steps=6,
        checkpoint_every=2,
        validate_every=6,
        validation_scenes=1,
    )
