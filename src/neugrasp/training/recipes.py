"""Named courses of training. Each is a function that returns a complete configuration."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

from neugrasp.errors import InputError
from neugrasp.model.config import ModelConfig
from neugrasp.training.command import Train
from neugrasp.training.config import LossWeights, Optimiser, TrainConfig
from neugrasp.training.extensions import extension

log = logging.getLogger(__name__)


def _small_model() -> ModelConfig:
    """Half the paper's widths."""
    return ModelConfig(
        encoder_width=16,
        feature_dim=16,
        volume_dim=8,
        fusion_hidden=40,
        fused_dim=32,
        coarse_samples=32,
        fine_samples=24,
        encoder_blocks=(2, 2, 3),
        use_change=True,
    )


def small() -> TrainConfig:
    """The default: half the paper's widths, without geometry supervision, for a day on a laptop's CPU."""
    return TrainConfig(
        model=_small_model(),
        weights=LossWeights(rehearsal=0.01, carving=0.1, grid_carving=0.3, table=0.1),
        steps=9_000,
        head_steps=5_000,
        optimiser=Optimiser(learning_rate=1e-3, head_learning_rate=1e-3, schedule="cosine", average=0.998),
        rays=128,
        validate_every=1_000,
        bfloat16=True,
    )


def finetune() -> TrainConfig:
    """`small` gone on with (`--init`): starts as sharp as weights are that have been trained before."""
    return replace(small(), steps=4_000, head_steps=0, sharpness=(180.0, 300.0))


def head_only() -> TrainConfig:
    """The grasp head of `small` alone, on true TSDFs: needs no photos, so physics-only records will do."""
    return replace(small(), steps=4_000, head_steps=4_000)


def paper() -> TrainConfig:
    """The paper's shapes, losses and schedule, literally: no carving, learned sharpness."""
    return TrainConfig(
        model=ModelConfig(learned_sharpness=True),
        weights=LossWeights(carving=0.0, grid_carving=0.0),
        view_dropout=0.0,
    )


def tsdf() -> TrainConfig:
    """The control: `small` with the TSDF itself as supervision."""
    weights = replace(small().weights, carving=0.0, grid_carving=0.0, table=0.0, tsdf=1.0)
    return replace(small(), weights=weights)


def geometry() -> TrainConfig:
    """Surfaces from the meshes themselves, in simulation only: cheap steps without rays, no grasps."""
    weights = LossWeights(
        photometric=0, eikonal=0, grasp=0, carving=0, grid_carving=0, distance=1.0, occupancy=0.1
    )
    return replace(
        small(), weights=weights, steps=4_000, head_steps=0, columns=320, min_views=1, validate_every=500
    )


def sim() -> TrainConfig:
    """`geometry` gone on with (`--init`): the whole grid and the grasps read from it."""
    weights = replace(geometry().weights, grasp=0.05, rehearsal=0.01, eikonal=0.01)
    return replace(geometry(), weights=weights, columns=0)


def adapt() -> TrainConfig:
    """NeuGrasp-RA: goes on (`--init`) with scenes of one cell, from photos and tried grasps alone, until the
    grasps of its last scenes are not told any better."""
    weights = replace(small().weights, rehearsal=0.0)
    return replace(
        finetune(), weights=weights, steps=2_000, optimiser=replace(small().optimiser, learning_rate=2e-4),
        sharpness=(300.0, 300.0), validate_every=100, validation_scenes=20, last_held_out=0.2, patience=5,
    )  # fmt: skip


def without_attention() -> TrainConfig:
    """Ablation "w/o f_attn" of `small`."""
    return replace(small(), model=replace(_small_model(), use_residual_attention=False))


def without_occupancy() -> TrainConfig:
    """Ablation "w/o V_occ" of `small`."""
    return replace(small(), model=replace(_small_model(), use_occupancy_prior=False))


def without_backgrounds() -> TrainConfig:
    """Ablation "w/o backgrounds" of `small`: the network does not see them; the losses still do."""
    return replace(small(), model=replace(_small_model(), use_backgrounds=False))


def tiny() -> TrainConfig:
    """A dozen steps on a laptop's CPU: what the tests run."""
    model = ModelConfig(
        image_size=64,
        encoder_width=4,
        encoder_blocks=(1, 1, 1),
        use_change=True,
        feature_dim=4,
        volume_dim=4,
        volume_hidden=(4, 4, 8, 8),
        heads=4,
        fusion_hidden=16,
        fused_dim=16,
        coarse_samples=12,
        fine_samples=8,
        head_channels=(4, 8, 8),
    )
    return replace(
        small(), model=model, bfloat16=False, steps=12, head_steps=4, head_batch=2, rays=48, carving_rays=16,
        checkpoint_every=5, validate_every=10, validation_scenes=1,
    )  # fmt: skip


RECIPES: dict[str, Callable[[], TrainConfig]] = {
    "small": small,
    "finetune": finetune,
    "head-only": head_only,
    "paper": paper,
    "tsdf": tsdf,
    "geometry": geometry,
    "sim": sim,
    "adapt": adapt,
    "without-attention": without_attention,
    "without-occupancy": without_occupancy,
    "without-backgrounds": without_backgrounds,
    "tiny": tiny,
}
RENAMED = {"longer": "finetune", "head": "head-only"}
"""Recipes by their names of before; they are read for one version more."""

GROUP = "neugrasp.recipes"
"""Entry points of recipes that are not of this file: functions that return a `TrainConfig`."""


def recipe(name: str) -> TrainConfig:
    """The configuration of a recipe by name or module:NAME. Raises `InputError` where there is none."""
    if today := RENAMED.get(name):
        log.warning("recipe %s is called %s now; the old name ends with the next version", name, today)
        name = today
    found = RECIPES.get(name) or extension(GROUP, name, "recipe", RECIPES)
    config = found() if callable(found) else found
    if not isinstance(config, TrainConfig):
        raise InputError(f"recipe {name}: gives a {type(config).__name__}, not a TrainConfig")
    return config


def configured(run: Train) -> TrainConfig:
    """The recipe with the run's facts in it.

    Raises `InputError` where the recipe needs weights to start from, or there is no step to make.
    """
    config = replace(recipe(run.recipe), seed=run.seed)
    if config.patience and not run.init:
        raise InputError(
            f"recipe {run.recipe} goes on from trained weights; name them, as in --init neugrasp"
        )
    if run.precision != "recipe":
        config = replace(config, bfloat16=run.precision == "bfloat16")
    if run.init and config.steps > config.head_steps:
        config = replace(config, steps=config.steps - config.head_steps, head_steps=0)
    if run.steps is None:
        return config
    if run.steps < 1:
        raise InputError(f"--steps {run.steps}: must be at least 1")
    return replace(config, steps=run.steps, head_steps=round(config.head_steps * run.steps / config.steps))
