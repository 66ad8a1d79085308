"""Which scenes are learned from, and which are kept aside."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from neugrasp.data.scene_sets import SceneSet, open_scenes
from neugrasp.errors import InputError
from neugrasp.geometry.symmetry import Symmetry
from neugrasp.training.command import Train
from neugrasp.training.config import TrainConfig
from neugrasp.training.dataset import Scenes
from neugrasp.training.networks import NetworkSpec
from neugrasp.training.samples import Sample, Truth

T = TypeVar("T")
Place = tuple[SceneSet, int]
HELD_OUT = 20
"""One scene of so many is kept aside for validation where no folder is given for it."""


class HeldOutScenes:
    """Some scenes that are not trained on."""

    def __init__(self, scenes: Scenes, config: TrainConfig):
        self._scenes = scenes
        self._with_photos = spread(scenes.photographed, config.validation_scenes)
        self._known = spread(scenes.known, 10 * config.validation_scenes)

    def __bool__(self) -> bool:
        return bool(self._with_photos or self._known)

    @cached_property
    def samples(self) -> list[Sample]:
        """With photos; made when first asked for."""
        return [self._scenes.sample(index, None) for index in self._with_photos]

    @cached_property
    def truths(self) -> list[Truth]:
        """Truths of known surface, with or without photos, and more of them: the head is quick."""
        return [self._scenes.truth(index, Symmetry()) for index in self._known]


def open_data(run: Train, config: TrainConfig, spec: NetworkSpec) -> tuple[Scenes, HeldOutScenes]:
    """The scenes to train on, and what is validated on.

    Raises `InputError` where there are none, or they lack what the recipe learns from.
    """
    folders = [_places(folder) for folder in run.data]
    if run.scenes is not None:
        total = sum(map(len, folders))
        if not 1 <= run.scenes <= total:
            raise InputError(f"--scenes {run.scenes}: --data holds 1 to {total}")
        folders = [spread([place for folder in folders for place in folder], run.scenes)]
    places, held = split(folders, config)
    if run.validation:
        places = [place for folder in folders for place in folder]
        held = [place for folder in run.validation for place in _places(folder)]
    size, weights = config.model.image_size, config.weights
    finds_changes = spec.compares and weights.finds_changes
    depths = {"reads_depths": bool(weights.depth), "reads_sensor": spec.measures}
    scenes = Scenes(places, size, finds_changes, weights.finds_changes, **depths)
    _check(run, config, scenes)
    held_out = HeldOutScenes(Scenes(held, size, finds_changes, **depths), config)
    if config.patience and not held_out:
        raise InputError(
            f"recipe {run.recipe} ends by scenes kept aside, and {len(places)} leave none; give two or more"
        )
    return scenes, held_out


def split(folders: Sequence[Sequence[Place]], config: TrainConfig) -> tuple[list[Place], list[Place]]:
    """What of some folders is trained on, and what is kept aside: some of every folder, so that each kind of
    scene is validated on."""
    if config.last_held_out:
        kept = 1 - config.last_held_out
        ends = [min(max(1, round(kept * len(folder))), max(1, len(folder) - 1)) for folder in folders]
        return (
            [place for folder, end in zip(folders, ends, strict=True) for place in folder[:end]],
            [place for folder, end in zip(folders, ends, strict=True) for place in folder[end:]],
        )
    places = [place for folder in folders for place in folder]
    held = places[HELD_OUT - 1 :: HELD_OUT]
    return [place for index, place in enumerate(places) if index % HELD_OUT != HELD_OUT - 1], held


def spread(things: Sequence[T], count: int) -> list[T]:
    """At most `count` of the things, evenly."""
    places = np.linspace(0, len(things) - 1, min(count, len(things))).astype(int)
    return [things[place] for place in places.tolist()]


def _places(folder: Path) -> list[Place]:
    scenes = open_scenes(folder)
    return [(scenes, index) for index in range(len(scenes))]


def _check(run: Train, config: TrainConfig, scenes: Scenes) -> None:
    names = ", ".join(map(str, run.data))
    if config.steps > config.head_steps and not scenes.photographed:
        raise InputError(f"{names}: no scene has photos; recipe {run.recipe} needs some, head-only none")
    if config.needs_truth and not scenes.known:
        raise InputError(
            f"{names}: no scene has a known surface, and recipe {run.recipe} learns from it; use scenes of "
            "`neugrasp generate`, or the recipe adapt, which needs photos and tried grasps alone"
        )
