"""Scenes -> training samples: one of the eight symmetries of the workspace, jitter, a choice of views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from neugrasp.data.grasp_scene import GraspScene
from neugrasp.errors import InputError
from neugrasp.geometry.sampling import CameraTensors
from neugrasp.geometry.symmetry import Symmetry
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.inputs import ViewTensors, crop_view, to_tensor
from neugrasp.observation import View, Views

ONLY_SIMULATED = "only scenes of `neugrasp generate` have one; the recipe adapt learns without"
HINTS = {
    "tsdf": ONLY_SIMULATED,
    "observed": ONLY_SIMULATED,
    "distance": "benchmarks/add_distance.py adds it to scenes of the simulator",
}
"""What helps where a grid is missing."""
FEWEST_IN_GROUPS = 6
"""Views of a scene from which on they are two groups; a group of fewer than 3 sees too little."""


@dataclass(frozen=True)
class LabelTensors:
    """`GraspLabels` of one scene, as the loss reads them."""

    index: Tensor
    """(p, 3) voxel of the grasp point."""
    quaternions: Tensor
    """(p, 4) xyzw."""
    widths: Tensor
    """(p,) voxels."""
    success: Tensor
    """(p,) bool."""

    def to(self, device: torch.device | str) -> LabelTensors:
        """The same labels on another device."""
        tensors = (self.index, self.quaternions, self.widths, self.success)
        return LabelTensors(*(tensor.to(device) for tensor in tensors))


@dataclass(frozen=True)
class Truth:
    """What came of grasps in a scene, and what a simulator knows of its surface; else there are no grids."""

    labels: LabelTensors
    tsdf: Tensor | None = None
    """(r, r, r); for the head's stage, the control recipe and validation. No other loss reads it."""
    observed: Tensor | None = None
    """(r, r, r) bool."""
    distance: Tensor | None = None
    """(r, r, r) signed distance of the meshes: what geometry supervision reads."""

    def needed(self, name: Literal["tsdf", "observed", "distance"]) -> Tensor:
        """A grid (r, r, r) that a loss cannot do without. Raises `InputError` where the scene lacks it."""
        grid: Tensor | None = getattr(self, name)
        if grid is None:
            raise InputError(
                f"a scene lacks the grid {name!r}, which a loss of this recipe compares with; {HINTS[name]}"
            )
        return grid

    def to(self, device: torch.device | str) -> Truth:
        """The same truth on another device."""
        grids = (self.tsdf, self.observed, self.distance)
        return Truth(self.labels.to(device), *(None if grid is None else grid.to(device) for grid in grids))


@dataclass(frozen=True)
class Photos:
    """Photos with the labels of what changed in them."""

    views: ViewTensors
    changes: Tensor
    """(n, s, s) int8 of `change_labels`."""

    def to(self, device: torch.device | str) -> Photos:
        """The same photos on another device."""
        return Photos(self.views.to(device), self.changes.to(device))


@dataclass(frozen=True)
class Sample:
    """What one training step knows of a scene."""

    inputs: Photos
    targets: Photos
    """Views that are never among the inputs."""
    truth: Truth

    def to(self, device: torch.device | str) -> Sample:
        """The same sample on another device."""
        return Sample(self.inputs.to(device), self.targets.to(device), self.truth.to(device))


@dataclass(frozen=True)
class PreparedView:
    """A view as the network wants it, with the labels of what changed: they are slow to find."""

    view: View
    """(s, s) photos; the camera in the workspace frame."""
    changes: np.ndarray
    """(s, s) int8 of `change_labels`."""


def crop_views(scene: GraspScene, size: int) -> tuple[tuple[View, ...], tuple[View, ...]]:
    """Inputs and targets of a scene, cropped to the workspace at size x size."""

    def cropped(views: Views | None) -> tuple[View, ...]:
        return tuple(
            crop_view(view, view.camera, scene.workspace.photo_box(view.camera), size)
            for view in (views.frames if views else ())
        )

    return cropped(scene.views), cropped(scene.targets)


def lent(
    views: tuple[PreparedView, ...], rng: np.random.Generator | None
) -> tuple[tuple[PreparedView, ...], tuple[PreparedView, ...]]:
    """Inputs and targets of a scene that has no targets of its own; without a generator always the same.

    From 6 views on those are two groups in their order, as the paper has for real scenes: one is seen, the
    other compared with. Of fewer, one is compared with.
    """
    count = len(views)
    if count >= FEWEST_IN_GROUPS:
        first, second = views[: (count + 1) // 2], views[(count + 1) // 2 :]
        return (first, second) if rng is None or rng.random() < 0.5 else (second, first)
    at = count - 1 if rng is None else int(rng.integers(count))
    return (*views[:at], *views[at + 1 :]), (views[at],)


def sample_of(
    scene: GraspScene,
    groups: tuple[tuple[PreparedView, ...], tuple[PreparedView, ...]],
    rng: np.random.Generator | None,
) -> Sample:
    """A training sample of a scene whose inputs and targets are prepared.

    With a generator it is augmented, without it is the scene as it stands.
    """
    symmetry = Symmetry() if rng is None else Symmetry.random(rng)
    inputs, *others = (_photos(group, symmetry, scene.workspace) for group in groups if group)
    if rng is not None:
        inputs, *others = _jitter([inputs, *others], rng)
    targets = others[0] if others else drop_views(inputs, [])
    return Sample(inputs, targets, truth_of(scene, symmetry))


def plain_sample(scene: GraspScene, size: int) -> Sample:
    """A scene as it stands, without labels of what changed in its photos: for validation."""
    unsure = np.full((size, size), -1, np.int8)
    inputs, targets = (
        tuple(PreparedView(view, unsure) for view in group) for group in crop_views(scene, size)
    )
    return sample_of(scene, (inputs, targets), None)


def truth_of(scene: GraspScene, symmetry: Symmetry) -> Truth:
    """Labels and true grids of a scene, moved by a symmetry."""
    labels = _labels(scene, symmetry)
    if scene.truth is None:
        return Truth(labels)
    truth = scene.truth
    return Truth(
        labels,
        torch.from_numpy(symmetry.of_grid(truth.tsdf.astype(np.float32))),
        torch.from_numpy(symmetry.of_grid(truth.observed)),
        None if truth.distance is None else torch.from_numpy(symmetry.of_grid(truth.distance)),
    )


def drop_views(photos: Photos, keep: list[int]) -> Photos:
    """Some of the photos, in the given order."""
    views = photos.views
    return Photos(
        ViewTensors(views.images[keep], views.backgrounds[keep], views.cameras.select(keep)),
        photos.changes[keep],
    )


def _photos(prepared: tuple[PreparedView, ...], symmetry: Symmetry, workspace: Workspace) -> Photos:
    views = [one.view for one in prepared]
    return Photos(
        ViewTensors(
            to_tensor([symmetry.of_image(view.image) for view in views]),
            to_tensor([symmetry.of_image(view.background) for view in views]),
            CameraTensors.of([symmetry.of_camera(view.camera, workspace) for view in views]),
        ),
        torch.from_numpy(np.stack([symmetry.of_image(one.changes) for one in prepared])),
    )


def _jitter(groups: list[Photos], rng: np.random.Generator) -> list[Photos]:
    """White balance, exposure and gamma alike on photos and backgrounds; noise and a little drift apart."""
    gain = torch.from_numpy(rng.uniform(0.85, 1.15, size=(1, 3, 1, 1)) * rng.uniform(0.8, 1.2)).float()
    gamma = float(rng.uniform(0.85, 1.15))
    noise, drift = rng.uniform(0.002, 0.012), 1 + rng.uniform(-0.01, 0.01)
    generator = torch.Generator().manual_seed(int(rng.integers(2**62)))

    def jittered(images: Tensor, factor: float) -> Tensor:
        # In place: the system's handing out of fresh pages costs more than the arithmetic.
        bright = (images * gain).mul_(factor).clamp_(1e-4, 1).pow_(gamma)
        return bright.add_(torch.randn(images.shape, generator=generator).mul_(noise)).clamp_(0, 1)

    return [
        Photos(
            ViewTensors(
                jittered(group.views.images, drift),
                jittered(group.views.backgrounds, 1.0),
                group.views.cameras,
            ),
            group.changes,
        )
        for group in groups
    ]


def _labels(scene: GraspScene, symmetry: Symmetry) -> LabelTensors:
    labels, workspace = scene.labels, scene.workspace
    matrix = symmetry.matrix(workspace)
    points = labels.points @ matrix[:3, :3].T + matrix[:3, 3]
    inside = workspace.contains(points)
    return LabelTensors(
        torch.from_numpy(workspace.index_of(points[inside])),
        torch.from_numpy(symmetry.of_rotations(labels.quaternions[inside])).float(),
        torch.from_numpy(labels.widths[inside] / workspace.voxel_size).float(),
        torch.from_numpy(labels.success[inside].astype(bool)),
    )
