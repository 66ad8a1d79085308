"""`neugrasp train` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal


@dataclass(frozen=True, kw_only=True)
class Train:
    """Trains the network on generated scenes. Continues with --resume exactly where it stopped.

    Every value of the recipe is an option, too (src/neugrasp/training/config.py): --optimiser.learning-rate
    3e-4, --weights.eikonal 0.2, --rays 512.
    """

    doing: ClassVar[str] = "reading the data, then training"

    data: tuple[Path, ...]
    """Folders made by `neugrasp generate`, or of shards packed from them."""
    out: Path
    """Folder for weights, checkpoints and logs."""
    recipe: str = "small"
    """Model, losses and schedule, by name (src/neugrasp/training/recipes.py)."""
    validation: tuple[Path, ...] = ()
    """Folders to validate on; without any, every twentieth scene is kept aside."""
    init: str | None = None
    """Weights to start from, by name or file. If they are of another network than the recipe's, only the
    grasp head is taken."""
    device: str = "cpu"
    """Device: cpu, cuda, cuda:1."""
    precision: Literal["recipe", "float32", "bfloat16"] = "recipe"
    """Precision of products and convolutions; the recipe's is bfloat16 where that is faster."""
    steps: int | None = None
    """Number of steps, instead of the recipe's."""
    seed: int = 0
    """Seed for initial weights and sample order."""
    scenes: int | None = None
    """Number of scenes to train on, evenly spread over --data; by default all."""
    loggers: tuple[Literal["tensorboard", "wandb"], ...] = ()
    """Loggers besides log.jsonl; tensorboard needs the extra `train`, wandb its own package."""
    resume: bool = False
    """Continue from the last checkpoint in --out."""
    loaders: int = 1
    """Number of processes that prepare scenes while a step runs; with 0, each step waits for its own."""


@dataclass(frozen=True, kw_only=True)
class TrainEvaluator:
    """Trains the evaluator of grasps on tried grasps. Continues with --resume exactly where it stopped."""

    doing: ClassVar[str] = "reading the lessons, then training"

    data: tuple[Path, ...]
    """Folders of lessons, as benchmarks/evaluator_lessons.py makes them; one scene of eight is kept aside."""
    out: Path
    """Folder for evaluator.safetensors, checkpoints and logs."""
    init: str | None = None
    """An evaluator to start from, by name or file."""
    device: str = "cpu"
    """Device: cpu, cuda, cuda:1."""
    steps: int = 5_000
    """Number of steps, of 256 grasps each."""
    seed: int = 0
    """Seed for initial weights and grasp order."""
    resume: bool = False
    """Continue from the last checkpoint in --out."""
