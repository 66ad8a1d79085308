"""The views of a scene as the network wants them: cropped, with what else a recipe reads of each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int8, Shaped

from neugrasp.data.grasp_scene import GraspScene
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.model.inputs import crop_view
from neugrasp.observation import View, Views

FEWEST_IN_GROUPS = 6
"""Views of a scene from which on they are two groups; a group of fewer than 3 sees too little."""


@dataclass(frozen=True)
class PreparedView:
    """A view as the network wants it, with the labels of what changed: they are slow to find."""

    view: View
    """Square photos; the camera in the workspace frame."""
    changes: Int8[np.ndarray, "size size"]
    """Labels of `change_labels`."""
    depth: Float[np.ndarray, "size size"] | None = None
    """As in `Photos`."""
    sensed: tuple[Float[np.ndarray, "size size"], Bool[np.ndarray, "size size"]] | None = None
    """As in `Sensor`."""


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


def depth_through(
    camera: Camera, photo: Camera, depth: Shaped[np.ndarray, "height width"]
) -> Shaped[np.ndarray, "{camera.height} {camera.width}"]:
    """The z-depths of a photo as its crop with `camera` shows them: of the nearest pixel, else 0."""
    if camera.width == photo.width and np.array_equal(camera.intrinsics, photo.intrinsics):
        return depth
    rays = np.concatenate([camera.pixel_grid(), np.ones((camera.height, camera.width, 1))], axis=-1)
    column, row, _ = np.moveaxis(rays @ (photo.intrinsics @ np.linalg.inv(camera.intrinsics)).T, -1, 0)
    column, row = (np.floor(each + 0.5).astype(int) for each in (column, row))
    known = (column >= 0) & (column < photo.width) & (row >= 0) & (row < photo.height)
    return np.where(known, depth[row.clip(0, photo.height - 1), column.clip(0, photo.width - 1)], 0)


def with_depths(scene: GraspScene, inputs: Iterable[PreparedView]) -> Iterable[PreparedView]:
    """The prepared input views of a scene with their true depths. Raises `InputError` where it has none."""
    depths = scene.truth.depths if scene.truth and scene.truth.depths is not None else np.zeros(0)
    if scene.views is None or not np.any(depths):
        raise InputError(
            f"{scene.name}: holds no depth of its photos, which this recipe learns from; use scenes as "
            "`neugrasp generate` writes them (shards packed with a --quality leave depth out)"
        )
    for view, photo, depth in zip(inputs, scene.views.frames, depths, strict=True):
        yield replace(view, depth=depth_through(view.view.camera, photo.camera, depth))


def with_sensor(scene: GraspScene, inputs: Iterable[PreparedView]) -> Iterable[PreparedView]:
    """The prepared input views of a scene with what a stereo sensor measured.

    Raises `InputError` where there was none.
    """
    masks = scene.truth.masks if scene.truth else None
    if scene.stereo is None or masks is None or scene.views is None:
        raise InputError(
            f"{scene.name}: holds no depth of a stereo sensor, which this recipe learns from; "
            "`neugrasp generate --stereo` makes scenes that do"
        )
    for view, photo, depth, mask in zip(inputs, scene.views.frames, scene.stereo, masks, strict=True):
        camera = view.view.camera
        objects = depth_through(camera, photo.camera, mask) > 0
        yield replace(view, sensed=(depth_through(camera, photo.camera, depth), objects))
