"""`neugrasp train` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal


@dataclass(frozen=True, kw_only=True)
class Train:
    """Trains the network on generated scenes. Goes on with --resume exactly where it stopped.

    Every value of the recipe is an option, too (src/neugrasp/training/config.py): --optimiser.learning-rate
    3e-4, --weights.eikonal 0.2, --rays 512.
    """

    doing: ClassVar[str] = "reading the data, then training"

    data: tuple[Path, ...]
    """Folders made by `neugrasp generate`, or of shards packed from them."""
    out: Path
    """Where weights, checkpoints and logs are written."""
    recipe: str = "small"
    """Model, losses and schedule, by name (src/neugrasp/training/recipes.py)."""
    validation: tuple[Path, ...] = ()
    """Folders to validate on; without any, every twentieth scene is kept aside."""
    init: str | None = None
    """Weights to start from, by name or file; of another network than the recipe's, only the grasp head is
    taken."""
    device: str = "cpu"
    """Where to compute: cpu, cuda, cuda:1."""
    precision: Literal["recipe", "float32", "bfloat16"] = "recipe"
    """Of products and convolutions; the recipe's is bfloat16 where that is faster."""
    steps: int | None = None
    """Instead of the recipe's number of steps."""
    seed: int = 0
    """Of the first weights and of the order of the samples."""
    scenes: int | None = None
    """Train on so many of the scenes, evenly spread over --data; by default on all."""
    loggers: tuple[Literal["tensorboard", "wandb"], ...] = ()
    """Where losses and scores go besides log.jsonl; tensorboard needs the extra `train`, wandb itself."""
    resume: bool = False
    """Go on from the last checkpoint in --out."""
    loaders: int = 1
    """Processes that prepare scenes while a step runs; 0: none, so that each step waits for its own."""


@dataclass(frozen=True, kw_only=True)
class TrainEvaluator:
    """Trains the evaluator of grasps on tried grasps. Goes on with --resume exactly where it stopped."""

    doing: ClassVar[str] = "reading the lessons, then training"

    data: tuple[Path, ...]
    """Folders of lessons, as benchmarks/evaluator_lessons.py makes them; one scene of eight is kept aside."""
    out: Path
    """Where evaluator.safetensors, checkpoints and logs are written."""
    init: str | None = None
    """An evaluator to start from, by name or file."""
    device: str = "cpu"
    """Where to compute: cpu, cuda, cuda:1."""
    steps: int = 5_000
    """Of 256 grasps each."""
    seed: int = 0
    """Of the first weights and of the order of the grasps."""
    resume: bool = False
    """Go on from the last checkpoint in --out."""
