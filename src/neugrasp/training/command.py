"""`neugrasp train` and `train-evaluator` as plain data; heavy parts load when one is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from neugrasp.errors import InputError


@dataclass(frozen=True)
class Train:
    """Trains the network on generated scenes. Goes on with --resume exactly where it stopped."""

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
    device: Literal["cpu", "cuda"] = "cpu"
    """Where to compute."""
    steps: int | None = None
    """Instead of the recipe's number of steps."""
    seed: int = 0
    """Of the first weights and of the order of the samples."""
    scenes: int | None = None
    """Train on so many of the scenes, evenly spread over --data; by default on all."""
    resume: bool = False
    """Go on from the last checkpoint in --out."""
    loaders: int = 1
    """Processes that prepare scenes while a step runs; 0: none, so that each step waits for its own."""

    def run(self) -> Path:
        import torch

        from neugrasp.training.trainer import TrainRun, train

        if self.device == "cuda" and not torch.cuda.is_available():
            raise InputError("--device cuda: PyTorch sees no CUDA device here; use --device cpu")
        return train(
            TrainRun(
                recipe=self.recipe,
                data=self.data,
                out=self.out,
                validation=self.validation,
                init=self.init,
                device=self.device,
                steps=self.steps,
                seed=self.seed,
                scenes=self.scenes,
                resume=self.resume,
                loaders=self.loaders,
            )
        )


@dataclass(frozen=True)
class TrainEvaluator:
    """Trains the evaluator of grasps on tried grasps. Goes on with --resume exactly where it stopped."""

    data: tuple[Path, ...]
    """Folders of lessons, as benchmarks/evaluator_lessons.py makes them; every tenth file is kept aside."""
    out: Path
    """Where evaluator.safetensors, checkpoints and logs are written."""
    init: str | None = None
    """An evaluator to start from, by name or file."""
    steps: int = 6_000
    """Of 256 grasps each."""
    seed: int = 0
    """Of the first weights and of the order of the grasps."""
    resume: bool = False
    """Go on from the last checkpoint in --out."""

    def run(self) -> str:
        """How good it is on what was kept aside."""
        from neugrasp.training.evaluator import (
            EvaluatorConfig,
            EvaluatorRun,
            reliability_table,
            train_evaluator,
        )

        if self.steps < 1:
            raise InputError(f"--steps {self.steps}: must be at least 1")
        config = EvaluatorConfig(steps=self.steps, seed=self.seed)
        run = EvaluatorRun(data=self.data, out=self.out, config=config, init=self.init, resume=self.resume)
        return f"{reliability_table(train_evaluator(run))}"
