"""The scenes of a training run, read when they are needed, and what every step sees of them."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch.utils.data import Dataset

from neugrasp.change_mask import change_labels
from neugrasp.data.grasp_scene import GraspScene
from neugrasp.data.records import PhotosWanted
from neugrasp.data.scene_sets import SceneSet
from neugrasp.errors import InputError
from neugrasp.geometry.symmetry import Symmetry
from neugrasp.geometry.workspace import USUAL
from neugrasp.observation import View
from neugrasp.training.config import TrainConfig
from neugrasp.training.prepared import PreparedView, crop_views, lent, with_depths, with_sensor
from neugrasp.training.samples import Sample, Truth, sample_of, truth_of


class Scenes:
    """Some scenes of several folders, prepared for the network each time they are asked for.

    Only labels of what changed in photos stay in memory, packed: they are slow to find.
    """

    def __init__(
        self,
        places: Sequence[tuple[SceneSet, int]],
        size: int,
        finds_changes: bool,
        reads_targets: bool = True,
        reads_depths: bool = False,
        reads_sensor: bool = False,
    ):
        self.places = tuple(places)
        """The folder and index of each scene."""
        self.size = size
        """Edge of the network's photos, pixels."""
        self.finds_changes = finds_changes
        """Whether `change_labels` of the photos are wanted; else all are UNSURE."""
        self.reads_targets = reads_targets
        """Whether the views that losses compare with are wanted; else there are none."""
        self.reads_depths = reads_depths
        """Whether the true depths of the input views are wanted."""
        self.reads_sensor = reads_sensor
        """Whether what a stereo sensor measured is wanted; scenes without it are refused then."""
        self.photographed = tuple(i for i, (sets, at) in enumerate(self.places) if sets.has_photos(at))
        """Indices of the scenes with photos."""
        self.known = tuple(i for i, (sets, at) in enumerate(self.places) if sets.has_truth(at))
        """Indices of the scenes whose surface is known."""
        self.workspace = self._read(0, "none").workspace if self.places else USUAL
        """The cube of all scenes."""
        self._changes: dict[tuple[int, int], bytes] = {}

    def __len__(self) -> int:
        return len(self.places)

    def sample(self, index: int, rng: np.random.Generator | None) -> Sample:
        """A scene with photos as a step sees it: augmented with a generator, as it stands without one."""
        scene = self._read(index, "all" if self.reads_targets else "inputs")
        inputs, targets = crop_views(scene, self.size)
        prepared = [self._prepared(index, place, view) for place, view in enumerate((*inputs, *targets))]
        groups = tuple(prepared[: len(inputs)]), tuple(prepared[len(inputs) :])
        if self.reads_depths:
            groups = tuple(with_depths(scene, groups[0])), groups[1]
        if self.reads_sensor:
            groups = tuple(with_sensor(scene, groups[0])), groups[1]
        return sample_of(scene, groups if targets or not self.reads_targets else lent(groups[0], rng), rng)

    def truth(self, index: int, symmetry: Symmetry) -> Truth:
        """Labels and grids of a scene, moved by a symmetry."""
        return truth_of(self._read(index, "none"), symmetry)

    def _read(self, index: int, photos: PhotosWanted) -> GraspScene:
        sets, at = self.places[index]
        scene = sets.scene(at, photos)
        if index and scene.workspace.cube != self.workspace.cube:
            raise InputError(
                f"{scene.name}: is about {scene.workspace.describe()}; the first scene is about "
                f"{self.workspace.describe()}, and a network learns one"
            )
        return scene

    def _prepared(self, index: int, place: int, view: View) -> PreparedView:
        if not self.finds_changes:
            return PreparedView(view, np.full(view.image.shape[:2], -1, np.int8))
        key = index, place
        if key not in self._changes:
            self._changes[key] = zlib.compress(change_labels(view.image, view.background).tobytes(), 1)
        labels = np.frombuffer(zlib.decompress(self._changes[key]), np.int8)
        return PreparedView(view, labels.reshape(view.image.shape[:2]))


def identity_of(scenes: Scenes) -> str:
    """A hash of the scenes of a run, in their order."""
    hashes: dict[int, str] = {}
    for sets, _ in scenes.places:
        if id(sets) not in hashes:
            hashes[id(sets)] = sets.identity()
    facts = [(hashes[id(sets)], index) for sets, index in scenes.places]
    return hashlib.sha256(repr(facts).encode()).hexdigest()


@dataclass(frozen=True)
class Batch:
    """What one step sees."""

    samples: tuple[Sample, ...]
    """Scenes with photos; none while the head is trained alone."""
    truths: tuple[Truth, ...]
    """Labels and grids for the head alone."""

    def to(self, device: torch.device | str) -> Batch:
        """The same batch on another device."""
        return Batch(
            tuple(sample.to(device) for sample in self.samples), tuple(one.to(device) for one in self.truths)
        )


class Steps(Dataset[Batch]):
    """The batch of every step of a run: a function of seed, rank and step, so that a run resumes exactly."""

    def __init__(self, scenes: Scenes, config: TrainConfig, rank: int = 0, ranks: int = 1):
        self.scenes, self.config, self.rank, self.ranks = scenes, config, rank, ranks

    def __len__(self) -> int:
        return self.config.steps

    def __getitem__(self, step: int) -> Batch:
        config = self.config
        in_head = step < config.head_steps
        samples: tuple[Sample, ...] = ()
        truths: tuple[Truth, ...] = ()
        if in_head or config.weights.rehearsal:
            truths = tuple(self._truth(place) for place in self._places(step, config.head_batch))
        if not in_head:
            samples = tuple(
                self._sample(place) for place in self._places(step - config.head_steps, config.batch)
            )
        return Batch(samples, truths)

    def _places(self, step: int, count: int) -> range:
        """Positions in the endless sequence of scenes that this rank's part of a step takes."""
        first = (step * self.ranks + self.rank) * count
        return range(first, first + count)

    def _index(self, place: int, num: int) -> int:
        """Which of `num` comes at a position of the sequence: a new shuffle in every epoch."""
        epoch, at = divmod(place, num)
        return int(np.random.default_rng([self.config.seed, 1, epoch]).permutation(num)[at])

    def _sample(self, place: int) -> Sample:
        photographed = self.scenes.photographed
        index = photographed[self._index(place, len(photographed))]
        return self.scenes.sample(index, np.random.default_rng([self.config.seed, 2, place]))

    def _truth(self, place: int) -> Truth:
        symmetry = Symmetry.random(np.random.default_rng([self.config.seed, 3, place]))
        known = self.scenes.known
        return self.scenes.truth(known[self._index(place, len(known))], symmetry)
