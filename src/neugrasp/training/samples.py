"""Scenes -> training samples: one of the eight symmetries of the workspace, jitter, a choice of views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float, Int8, Int64, Shaped
from torch import Tensor

from neugrasp.data.grasp_scene import GraspScene
from neugrasp.errors import InputError
from neugrasp.geometry.sampling import CameraTensors
from neugrasp.geometry.symmetry import Symmetry
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.inputs import ViewTensors, to_tensor
from neugrasp.training.prepared import PreparedView, crop_views

ONLY_SIMULATED = "only scenes of `neugrasp generate` have one; the recipe adapt learns without"
HINTS = {
    "tsdf": ONLY_SIMULATED,
    "observed": ONLY_SIMULATED,
    "fused": "benchmarks/add_fused.py adds them to scenes of the simulator",
    "distance": "benchmarks/add_distance.py adds it to scenes of the simulator",
}
"""What helps where a grid is missing."""


@dataclass(frozen=True)
class LabelTensors:
    """`GraspLabels` of one scene, as the loss reads them."""

    index: Int64[Tensor, "grasps 3"]
    """Voxel of the grasp point."""
    quaternions: Float[Tensor, "grasps 4"]
    """Orientations, xyzw."""
    widths: Float[Tensor, " grasps"]
    """Voxels."""
    success: Bool[Tensor, " grasps"]
    """Whether it held."""

    def to(self, device: torch.device | str) -> LabelTensors:
        """The same labels on another device."""
        tensors = (self.index, self.quaternions, self.widths, self.success)
        return LabelTensors(*(tensor.to(device) for tensor in tensors))


@dataclass(frozen=True)
class Truth:
    """What came of grasps in a scene, and what a simulator knows of its surface; else there are no grids."""

    labels: LabelTensors
    tsdf: Float[Tensor, "r r r"] | None = None
    """In [-1, 1]; for the head's stage, the control recipe and validation. No other loss reads it."""
    observed: Bool[Tensor, "r r r"] | None = None
    """Voxels that a view saw."""
    distance: Float[Tensor, "r r r"] | None = None
    """Signed distance of the meshes, in truncation units: what geometry supervision reads."""
    fused: Float[Tensor, "grids r r r"] | None = None
    """Grids fused from few views, in [0, 1]: what VGN reads."""

    def needed(
        self, name: Literal["tsdf", "observed", "distance", "fused"]
    ) -> Shaped[Tensor, "*grids r r r"]:
        """A grid that a loss cannot do without.

        Raises `InputError` where the scene lacks it.
        """
        grid: Tensor | None = getattr(self, name)
        if grid is None:
            raise InputError(
                f"a scene lacks the grid {name!r}, which a loss of this recipe compares with; {HINTS[name]}"
            )
        return grid

    def to(self, device: torch.device | str) -> Truth:
        """The same truth on another device."""
        grids = (self.tsdf, self.observed, self.distance, self.fused)
        return Truth(self.labels.to(device), *(None if grid is None else grid.to(device) for grid in grids))


@dataclass(frozen=True)
class Sensor:
    """What a stereo sensor measured where photos were taken."""

    measured: Float[Tensor, "views size size"]
    """z-depth, metres, 0 where nothing was measured."""
    objects: Bool[Tensor, "views size size"]
    """Pixels of objects."""

    def to(self, device: torch.device | str) -> Sensor:
        """The same on another device."""
        return Sensor(self.measured.to(device), self.objects.to(device))


@dataclass(frozen=True)
class Photos:
    """Photos with the labels of what changed in them."""

    views: ViewTensors
    changes: Int8[Tensor, "views size size"]
    """Labels of `change_labels`."""
    depths: Float[Tensor, "views size size"] | None = None
    """True z-depths, metres, 0 where there is no surface, of photos for which they are known: what
    supervision by depth reads."""
    sensor: Sensor | None = None
    """Where it is asked for."""

    def to(self, device: torch.device | str) -> Photos:
        """The same photos on another device."""
        depths = None if self.depths is None else self.depths.to(device)
        sensor = None if self.sensor is None else self.sensor.to(device)
        return Photos(self.views.to(device), self.changes.to(device), depths, sensor)


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
        None if truth.fused is None else torch.from_numpy(np.stack(list(map(symmetry.of_grid, truth.fused)))),
    )


def drop_views(photos: Photos, keep: list[int]) -> Photos:
    """Some of the photos, in the given order."""
    views = photos.views
    return Photos(
        ViewTensors(views.images[keep], views.backgrounds[keep], views.cameras.select(keep)),
        photos.changes[keep],
        None if photos.depths is None else photos.depths[keep],
        None if photos.sensor is None else Sensor(photos.sensor.measured[keep], photos.sensor.objects[keep]),
    )


def _photos(prepared: tuple[PreparedView, ...], symmetry: Symmetry, workspace: Workspace) -> Photos:
    views = [one.view for one in prepared]
    depths = [symmetry.of_image(one.depth) for one in prepared if one.depth is not None]
    sensed = [[symmetry.of_image(each) for each in one.sensed] for one in prepared if one.sensed is not None]
    measured = [torch.from_numpy(np.stack(each)) for each in zip(*sensed, strict=True)]
    return Photos(
        ViewTensors(
            to_tensor([symmetry.of_image(view.image) for view in views]),
            to_tensor([symmetry.of_image(view.background) for view in views]),
            CameraTensors.of([symmetry.of_camera(view.camera, workspace) for view in views]),
        ),
        torch.from_numpy(np.stack([symmetry.of_image(one.changes) for one in prepared])),
        torch.from_numpy(np.stack(depths)) if depths else None,
        Sensor(*measured) if measured else None,
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
            group.depths,
            group.sensor,
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
