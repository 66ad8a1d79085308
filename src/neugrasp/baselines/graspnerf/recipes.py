"""Courses of training of GraspNeRF. Widths follow the rule of our own: `small` has half the paper's."""

from __future__ import annotations

from dataclasses import replace

from neugrasp.baselines.graspnerf.config import GraspNerfConfig
from neugrasp.training.config import LossWeights, Optimiser, TrainConfig

NETWORK = "graspnerf"


def _small_model() -> GraspNerfConfig:
    """Half the original's widths."""
    return GraspNerfConfig(
        encoder_width=16,
        image_blocks=(1, 2, 3),
        ray_blocks=(2, 2, 3),
        feature_dim=16,
        hidden_dim=32,
        ray_dim=8,
        heads=2,
        coarse_samples=32,
        fine_samples=24,
    )


def graspnerf_tsdf() -> TrainConfig:
    """With everything that knows geometry: depth and TSDF. Weights of the losses are the original's; besides,
    the head goes on learning from true grids, as our own does, since a short course has few scenes for it."""
    return TrainConfig(
        network=NETWORK,
        model=_small_model(),
        weights=LossWeights(
            photometric=0.01,
            depth=1.0,
            tsdf=1.0,
            eikonal=0.1,
            grasp=0.01,
            rehearsal=0.01,
            carving=0,
            grid_carving=0,
        ),
        steps=9_000,
        head_steps=5_000,
        head_batch=4,
        optimiser=Optimiser(learning_rate=1e-3, head_learning_rate=1e-3, schedule="cosine", average=0.998),
        rays=128,
        columns=324,
        whole_every=4,
        validate_every=1_000,
        bfloat16=True,
    )


def graspnerf() -> TrainConfig:
    """Photos and grasps alone: nothing that knows geometry, not even a head that true grids have taught."""
    weights = replace(graspnerf_tsdf().weights, depth=0.0, tsdf=0.0, rehearsal=0.0)
    return replace(graspnerf_tsdf(), weights=weights, head_steps=0)


def paper() -> TrainConfig:
    """The original's shapes, losses and schedule, with supervision."""
    return replace(
        graspnerf_tsdf(),
        weights=replace(graspnerf_tsdf().weights, rehearsal=0.0),
        model=GraspNerfConfig(),
        steps=500_000,
        head_steps=0,
        optimiser=Optimiser(),
        rays=512,
        columns=0,
        view_dropout=0.0,
        validate_every=5_000,
        bfloat16=False,
    )


def tiny() -> TrainConfig:
    """A dozen steps on a laptop's CPU: what the tests run."""
    model = GraspNerfConfig(
        image_size=64,
        encoder_width=4,
        image_blocks=(1, 1, 1),
        ray_blocks=(1, 1, 1),
        feature_dim=8,
        hidden_dim=16,
        ray_dim=8,
        heads=2,
        coarse_samples=12,
        fine_samples=8,
        head_channels=(4, 8, 8),
    )
    return replace(
        graspnerf_tsdf(), model=model, bfloat16=False, steps=8, head_steps=2, head_batch=2, rays=48,
        columns=64, whole_every=2, checkpoint_every=3, validate_every=8, validation_scenes=1,
    )  # fmt: skip


def tiny_without() -> TrainConfig:
    """`tiny` without anything that knows geometry."""
    return replace(tiny(), weights=graspnerf().weights, head_steps=0)
