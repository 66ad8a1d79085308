"""Everything a training run depends on, besides its data."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from neugrasp.model.config import ModelConfig, NetworkConfig

HALVINGS = 6
WARM_UP = 50


@dataclass(frozen=True, kw_only=True)
class LossWeights:
    """What each term counts for; 0 leaves it out."""

    photometric: float = 0.1
    """Squared error summed over RGB; coarse and fine each (released code: 0.1)."""
    eikonal: float = 0.1
    grasp: float = 0.01
    rehearsal: float = 0.0
    """The grasp loss on true grids in the joint stage, too: the head goes on learning from scenes without
    photos."""
    carving: float = 0.1
    """Background carving along the rendered rays: cross-entropy of what pixels that changed, or did not, say
    of the space in front of them."""
    grid_carving: float = 0.1
    """The same along rays of all photos through the grid."""
    table: float = 0.0
    """Where a photo shows the table, the surface lies in the table's plane."""
    tsdf: float = 0.0
    """Geometry supervision by the fused TSDF, as the released code has it; only the control recipe does."""
    depth: float = 0.0
    """Geometry supervision by depth images of the input views, of networks that say where their rays end."""
    distance: float = 0.0
    """Geometry supervision by the signed distance of the meshes."""
    occupancy: float = 0.0
    """Geometry supervision by what is inside the meshes: the cross-entropy of the field's sign."""

    @property
    def renders(self) -> bool:
        """Whether a loss asks for renderings of target views."""
        return bool(self.photometric or self.carving)

    @property
    def finds_changes(self) -> bool:
        """Whether a loss asks what changed in the photos."""
        return bool(self.renders or self.grid_carving or self.table)

    @property
    def needs_grid(self) -> bool:
        """Whether a loss asks for the signed distance at every voxel."""
        return bool(self.grasp or self.eikonal or self.tsdf or self.grid_carving or self.table)


@dataclass(frozen=True, kw_only=True)
class Optimiser:
    """Adam, and how its learning rate falls over a stage."""

    learning_rate: float = 1e-4
    head_learning_rate: float = 3e-4
    """While the head is trained alone."""
    schedule: Literal["staircase", "cosine"] = "staircase"
    """Halved six times (the paper: every 50k of 300k steps), or along a half cosine after 50 steps of warming
    up."""
    average: float = 0.0
    """Decay per step of the moving average of the weights, which is validated and shipped; 0: none."""
    gradient_clip: float = 1.0
    """Largest norm of a step's gradient."""


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """A course of training: first the grasp head alone on true TSDFs, then everything on photos."""

    network: str = "neugrasp"
    """Which network: a name of the registry, or module:NAME of a `NetworkSpec`."""
    model: NetworkConfig = field(default_factory=ModelConfig)
    """Its sizes and switches."""
    weights: LossWeights = field(default_factory=LossWeights)
    steps: int = 300_000
    head_steps: int = 0
    """How many of the steps train the head alone, on true TSDFs made imperfect."""
    head_batch: int = 8
    """Grids in one step of the head's stage."""
    batch: int = 1
    """Scenes with photos in one step of the joint stage, one after the other."""
    optimiser: Optimiser = field(default_factory=Optimiser)
    columns: int = 0
    """Random columns of voxels that geometry supervision asks for in a step where no loss needs the whole
    grid; 0: all."""
    whole_every: int = 1
    """Every how many steps a network that learns from a window of columns is asked for the whole grid, and
    learns grasps."""
    rays: int = 2304
    """Rays of the target view per step."""
    carving_rays: int = 512
    """Rays of each photo, inputs and targets, that carve the grid."""
    sharpness: tuple[float, float] = (80.0, 400.0)
    """NeuS sharpness in 1 / m at the start and the end, in geometric steps, unless the model learns it."""
    view_dropout: float = 0.3
    """Probability that a step sees fewer views than the record has."""
    min_views: int = 2
    """Fewest views that such a step sees."""
    bfloat16: bool = False
    """Whether products and convolutions run in bfloat16 where that is faster; weights and moments stay
    float32."""
    seed: int = 0
    checkpoint_every: int = 100
    validate_every: int = 2000
    validation_scenes: int = 8
    last_held_out: float = 0.0
    """Share of the scenes of every folder, the last ones, that is kept aside where no folder is given for
    validation; 0: every twentieth."""
    patience: int = 0
    """Validations without a lower grasp loss after which training ends; the weights are those of the lowest.
    0: train to the end, and ship its weights."""

    @property
    def needs_truth(self) -> bool:
        """Whether a step asks for grids that only a simulator knows."""
        weights = self.weights
        return bool(
            self.head_steps or weights.rehearsal or weights.tsdf or weights.distance or weights.occupancy
        )

    def learning_rate_at(self, step: int) -> float:
        """Falls within each stage, never below a hundredth of its start."""
        in_head = step < self.head_steps
        start, length = (0, self.head_steps) if in_head else (self.head_steps, self.steps - self.head_steps)
        optimiser = self.optimiser
        base = optimiser.head_learning_rate if in_head else optimiser.learning_rate
        progress = (step - start) / max(1, length)
        if optimiser.schedule == "staircase":
            return base * max(0.01, 0.5 ** int(progress * HALVINGS))
        warm = min(1.0, (step - start + 1) / min(WARM_UP, 1 + length // 10))
        return base * warm * max(0.01, 0.5 + 0.5 * math.cos(math.pi * progress))

    def sharpness_at(self, step: int) -> float:
        """Scheduled NeuS sharpness in 1 / m; reaches its end at two thirds of the joint stage."""
        start, end = self.sharpness
        progress = (step - self.head_steps) / max(1, self.steps - self.head_steps)
        return start * (end / start) ** min(1.0, max(0.0, 1.5 * progress))
