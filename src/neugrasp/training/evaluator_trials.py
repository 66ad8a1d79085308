"""Tried grasps as the evaluator of grasps sees them, and in which order it learns them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Bool, Float, Int8, Int64
from scipy.spatial.transform import Rotation
from torch import Tensor
from torch.utils.data import Dataset

from neugrasp.data.lessons import Lesson
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.model.grasp_evaluator import BOX, FineGrid, Hand, boxes, numbers


class Passes(Protocol):
    """What the order of the trials follows from."""

    @property
    def steps(self) -> int: ...

    @property
    def batch(self) -> int: ...

    @property
    def seed(self) -> int: ...

    @property
    def weight_of_collisions(self) -> float: ...


@dataclass(frozen=True)
class TrialBatch:
    """The trials of one step."""

    box: Int8[Tensor, "k 7 23 16"]
    """As `boxes` gives them."""
    of_up: Float[Tensor, "k 4"]
    """As `numbers` gives them."""
    hand: Hand
    """The k grippers that they were tried with."""
    success: Float[Tensor, " k"]
    """1 where it held, else 0."""
    weights: Float[Tensor, " k"]
    """What each counts for."""

    def to(self, device: torch.device | str) -> TrialBatch:
        """The same on another device."""
        return TrialBatch(
            self.box.to(device),
            self.of_up.to(device),
            self.hand.to(device),
            self.success.to(device),
            self.weights.to(device),
        )


@dataclass(frozen=True)
class Seen:
    """Trials as the network sees them."""

    box: Int8[Tensor, "k 7 23 16"]
    """As `boxes` gives them."""
    of_up: Float[Tensor, "k 4"]
    """As `numbers` gives them."""
    hands: Hand
    """All grippers."""
    hand: Int64[Tensor, " k"]
    """Which of them each was tried with."""
    success: Float[Tensor, " k"]
    """1 where it held, else 0."""
    free: Bool[np.ndarray, " k"]
    """Whether the hand got there without a collision."""


def seen_of(lessons: list[tuple[Lesson, Gripper]], workspace: Workspace) -> Seen:
    """All trials of some lessons, each with the gripper that tried."""
    box, of_up = [], []
    grippers = list({id(gripper): gripper for _, gripper in lessons}.values())
    places = {id(gripper): place for place, gripper in enumerate(grippers)}
    for lesson, _ in lessons:
        poses = np.zeros((len(lesson), 4, 4), np.float32)
        if len(lesson):
            poses[:, :3, :3] = Rotation.from_quat(lesson.quaternions).as_matrix()
        poses[:, :3, 3], poses[:, 3, 3] = lesson.positions, 1
        told = torch.from_numpy(poses)
        of_up.append(numbers(told, workspace))
        here = torch.zeros(len(lesson), *BOX, dtype=torch.int8)
        for number, grid in enumerate(lesson.grids):
            where = torch.from_numpy(np.flatnonzero(lesson.seen == number))
            fine = FineGrid.of(torch.from_numpy(grid.astype(np.float32)), workspace)
            here[where] = boxes(fine, told[where])
        box.append(here)
    success = np.concatenate([lesson.success for lesson, _ in lessons]).astype(np.float32)
    return Seen(
        torch.cat(box),
        torch.cat(of_up),
        Hand.joined([Hand.of(gripper) for gripper in grippers]),
        torch.cat([torch.full((len(lesson),), places[id(gripper)]) for lesson, gripper in lessons]),
        torch.from_numpy(success),
        np.concatenate([lesson.free for lesson, _ in lessons]),
    )


class TrialSteps(Dataset[TrialBatch]):
    """Which trials a step sees: each once in every pass, in another order each time."""

    def __init__(self, taught: Seen, config: Passes):
        self.taught, self.config = taught, config
        self.weights = torch.from_numpy(np.where(taught.free, 1.0, config.weight_of_collisions)).float()

    def __len__(self) -> int:
        return self.config.steps

    def __getitem__(self, step: int) -> TrialBatch:
        count = len(self.taught.success)
        size = min(self.config.batch, count)
        per_pass = count // size
        order = np.random.default_rng([self.config.seed, step // per_pass]).permutation(count)
        place = (step % per_pass) * size
        chosen = torch.from_numpy(order[place : place + size])
        taught = self.taught
        return TrialBatch(
            taught.box[chosen],
            taught.of_up[chosen],
            taught.hands[taught.hand[chosen]],
            taught.success[chosen],
            self.weights[chosen],
        )
