"""Records -> training samples: one of the eight symmetries of the workspace, jitter, a choice of views."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from neugrasp.data.records import Record
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.sampling import CameraTensors
from neugrasp.geometry.symmetry import Symmetry
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.inputs import ViewTensors, crop_view, to_tensor
from neugrasp.observation import View, Views


@dataclass(frozen=True)
class GraspLabels:
    """Trials of one scene, as the loss reads them."""

    index: Tensor
    """(p, 3) voxel of the grasp point."""
    quaternions: Tensor
    """(p, 4) xyzw."""
    widths: Tensor
    """(p,) voxels."""
    success: Tensor
    """(p,) bool."""

    def to(self, device: torch.device | str) -> GraspLabels:
        """The same labels on another device."""
        tensors = (self.index, self.quaternions, self.widths, self.success)
        return GraspLabels(*(tensor.to(device) for tensor in tensors))


@dataclass(frozen=True)
class Truth:
    """What the simulator knows of a scene."""

    labels: GraspLabels
    tsdf: Tensor
    """(r, r, r); for the head's stage, the control recipe and validation. No other loss reads it."""
    observed: Tensor
    """(r, r, r) bool."""
    distance: Tensor | None = None
    """(r, r, r) signed distance of the meshes, where the record has it: what geometry supervision reads."""
    fused: Tensor | None = None
    """(g, r, r, r) grids fused from few views, in [0, 1], where the record has them: what VGN reads."""

    def to(self, device: torch.device | str) -> Truth:
        """The same truth on another device."""
        some = [None if grid is None else grid.to(device) for grid in (self.distance, self.fused)]
        return Truth(self.labels.to(device), self.tsdf.to(device), self.observed.to(device), *some)


@dataclass(frozen=True)
class Sensor:
    """What a stereo sensor measured where photos were taken."""

    measured: Tensor
    """(n, s, s) z-depth, metres, 0 where nothing was measured."""
    objects: Tensor
    """(n, s, s) bool: pixels of objects."""

    def to(self, device: torch.device | str) -> Sensor:
        """The same on another device."""
        return Sensor(self.measured.to(device), self.objects.to(device))


@dataclass(frozen=True)
class Photos:
    """Photos with the labels of what changed in them."""

    views: ViewTensors
    changes: Tensor
    """(n, s, s) int8 of `change_labels`."""
    depths: Tensor | None = None
    """(n, s, s) true z-depths, metres, 0 where there is no surface, of photos for which they are known: what
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


@dataclass(frozen=True)
class PreparedView:
    """A view as the network wants it, with the labels of what changed: they are slow to find."""

    view: View
    """(s, s) photos; the camera in the workspace frame."""
    changes: np.ndarray
    """(s, s) int8 of `change_labels`."""
    depth: np.ndarray | None = None
    """(s, s) as in `Photos`."""
    sensed: tuple[np.ndarray, np.ndarray] | None = None
    """(s, s) each, as in `Sensor`."""


def crop_views(record: Record, workspace: Workspace, size: int) -> tuple[tuple[View, ...], tuple[View, ...]]:
    """Inputs and targets of a record, cropped to the workspace at size x size."""

    def cropped(views: Views) -> tuple[View, ...]:
        boxes = [workspace.photo_box(view.camera) for view in views.frames]
        return tuple(
            crop_view(view, view.camera, box, size) for view, box in zip(views.frames, boxes, strict=True)
        )

    targets = record.target_views(workspace) if len(record.targets) else None
    return cropped(record.views(workspace)), cropped(targets) if targets else ()


def depth_through(camera: Camera, photo: Camera, depth: np.ndarray) -> np.ndarray:
    """The z-depths (h, w) of a photo as its crop with `camera` shows them: of the nearest pixel, else 0."""
    if camera.width == photo.width and np.array_equal(camera.intrinsics, photo.intrinsics):
        return depth
    rays = np.concatenate([camera.pixel_grid(), np.ones((camera.height, camera.width, 1))], axis=-1)
    column, row, _ = np.moveaxis(rays @ (photo.intrinsics @ np.linalg.inv(camera.intrinsics)).T, -1, 0)
    column, row = (np.floor(each + 0.5).astype(int) for each in (column, row))
    known = (column >= 0) & (column < photo.width) & (row >= 0) & (row < photo.height)
    return np.where(known, depth[row.clip(0, photo.height - 1), column.clip(0, photo.width - 1)], 0)


def with_depths(record: Record, inputs: Iterable[PreparedView]) -> Iterable[PreparedView]:
    """The prepared input views of a record with their true depths."""
    for view, photo, depth in zip(inputs, record.cameras, record.depths, strict=True):
        yield replace(view, depth=depth_through(view.view.camera, photo, depth))


def with_sensor(record: Record, inputs: Iterable[PreparedView]) -> Iterable[PreparedView]:
    """The prepared input views of a record with what a stereo sensor measured.

    Raises `InputError` where there was none.
    """
    if record.stereo is None:
        raise InputError(
            f"{record.name}: holds no depth of a stereo sensor, which this recipe learns from; "
            "`neugrasp generate --stereo` makes scenes that do"
        )
    for view, photo, depth, mask in zip(inputs, record.cameras, record.stereo, record.masks, strict=True):
        camera = view.view.camera
        objects = depth_through(camera, photo, mask) > 0
        yield replace(view, sensed=(depth_through(camera, photo, depth), objects))


def sample_of(
    record: Record,
    groups: tuple[tuple[PreparedView, ...], tuple[PreparedView, ...]],
    workspace: Workspace,
    rng: np.random.Generator | None,
) -> Sample:
    """A training sample of a record whose inputs and targets are prepared.

    With a generator it is augmented, without it is the record as it stands.
    """
    symmetry = Symmetry() if rng is None else Symmetry.random(rng)
    inputs, *others = (_photos(group, symmetry, workspace) for group in groups if group)
    if rng is not None:
        inputs, *others = _jitter([inputs, *others], rng)
    targets = others[0] if others else drop_views(inputs, [])
    return Sample(inputs, targets, truth_of(record, symmetry, workspace))


def plain_sample(record: Record, workspace: Workspace, size: int) -> Sample:
    """A record as it stands, without labels of what changed in its photos: for validation."""
    groups = crop_views(record, workspace, size)
    unsure = np.full((size, size), -1, np.int8)
    inputs, targets = (tuple(PreparedView(view, unsure) for view in group) for group in groups)
    return sample_of(record, (inputs, targets), workspace, None)


def truth_of(record: Record, symmetry: Symmetry, workspace: Workspace) -> Truth:
    """Labels and true grid of a record, moved by a symmetry."""
    return Truth(
        _labels(record, symmetry, workspace),
        torch.from_numpy(symmetry.of_grid(record.tsdf.astype(np.float32))),
        torch.from_numpy(symmetry.of_grid(record.observed)),
        None if record.distance is None else torch.from_numpy(symmetry.of_grid(record.distance)),
        None
        if record.fused is None
        else torch.from_numpy(np.stack(list(map(symmetry.of_grid, record.fused)))),
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


def _labels(record: Record, symmetry: Symmetry, workspace: Workspace) -> GraspLabels:
    labels = record.labels
    matrix = symmetry.matrix(workspace)
    points = labels.points @ matrix[:3, :3].T + matrix[:3, 3]
    inside = workspace.contains(points)
    return GraspLabels(
        torch.from_numpy(workspace.index_of(points[inside])),
        torch.from_numpy(symmetry.of_rotations(labels.quaternions[inside])).float(),
        torch.from_numpy(labels.widths[inside] / workspace.voxel_size).float(),
        torch.from_numpy(labels.success[inside].astype(bool)),
    )
