"""Views as the network wants them: cropped to the workspace, resized, as tensors in the workspace frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8
from PIL import Image as PilImage
from torch import Tensor

from neugrasp.errors import InputError
from neugrasp.geometry.camera import Box, Camera
from neugrasp.geometry.pose import inverse
from neugrasp.geometry.sampling import CameraTensors
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import View, Views

SAME_CROP = 1.0
"""Pixels by which a crop may miss the wanted one and still pass as it is."""


@dataclass(frozen=True)
class ViewTensors:
    """What one forward pass reads; everything in the workspace frame."""

    images: Float[Tensor, "views 3 size size"]
    """RGB in [0, 1]."""
    backgrounds: Float[Tensor, "views 3 size size"]
    """RGB in [0, 1]."""
    cameras: CameraTensors

    def to(self, device: torch.device | str) -> ViewTensors:
        """The same views on another device."""
        return ViewTensors(self.images.to(device), self.backgrounds.to(device), self.cameras.to(device))


def to_tensor(
    images: Sequence[UInt8[np.ndarray, "height width 3"]],
) -> Float32[Tensor, "views 3 height width"]:
    """Photos as tensors in [0, 1]."""
    return torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2).float() / 255


def crop_and_resize(
    image: UInt8[np.ndarray, "height width 3"], box: Box, sensed: Box, size: int
) -> UInt8[np.ndarray, "{size} {size} 3"]:
    """The part of a photo inside `box` (pixel edges), averaged where it shrinks.

    What lies outside `sensed` is filled by repeating the nearest measured pixel.
    """
    left, top, right, bottom = (round(edge + 0.5) for edge in sensed)
    measured = image[max(top, 0) : bottom, max(left, 0) : right]
    pad = int(np.ceil(max(0, *(np.abs(box)), *measured.shape[:2])))
    x0, y0, x1, y1 = box
    reach = [y0 + 0.5 - top, bottom - y1 - 0.5, x0 + 0.5 - left, right - x1 - 0.5]
    before_y, after_y, before_x, after_x = (min(pad, int(np.ceil(max(0.0, -r)))) for r in reach)
    padded = np.pad(measured, ((before_y, after_y), (before_x, after_x), (0, 0)), mode="edge")
    # PIL boxes count from the left edge of the first pixel.
    origin = np.array([left - before_x, top - before_y, left - before_x, top - before_y])
    inside = np.clip(np.array(box) + 0.5 - origin, 0, [padded.shape[1], padded.shape[0]] * 2)
    resized = PilImage.fromarray(padded).resize((size, size), PilImage.Resampling.BILINEAR, box=tuple(inside))
    return np.asarray(resized)


def crop_view(view: View, camera: Camera, box: Box, size: int) -> View:
    """A view cut out of `box` at size x size, with `camera` in the workspace frame.

    A photo that is such a crop already, as the generator renders them, passes unchanged.
    """
    whole = (-0.5, -0.5, size - 0.5, size - 0.5)
    if (camera.width, camera.height) == (size, size) and np.allclose(box, whole, atol=SAME_CROP):
        return replace(view, camera=camera)
    return replace(
        view,
        image=crop_and_resize(view.image, box, camera.bounds, size),
        background=crop_and_resize(view.background, box, camera.bounds, size),
        camera=camera.cropped_and_resized(box, size, size),
    )


def prepare(views: Views, size: int) -> ViewTensors:
    """Crops every photo to the workspace and resizes it to `size`, the cameras with it.

    Any number of views, each of any resolution. Raises `InputError` where a photo misses the workspace.
    """
    workspace_from_world = inverse(views.workspace.world_from_workspace)
    cropped = []
    for index, view in enumerate(views.frames):
        camera = view.camera.moved(workspace_from_world)
        box = views.workspace.photo_box(camera)
        _check_box(box, camera, views.workspace, view.name or f"view {index}")
        cropped.append(crop_view(view, camera, box, size))
    return ViewTensors(
        to_tensor([view.image for view in cropped]),
        to_tensor([view.background for view in cropped]),
        CameraTensors.of([view.camera for view in cropped]),
    )


def _check_box(box: Box, camera: Camera, workspace: Workspace, name: str) -> None:
    pixels, depth = camera.project(workspace.centre)
    left, top, right, bottom = camera.bounds
    if depth <= 0 and box == camera.bounds:
        raise InputError(
            f"{name}: the workspace lies behind the camera; poses must be world_from_camera of an OpenCV "
            f"camera (x right, y down, z forward)"
        )
    if not (left <= pixels[0] <= right and top <= pixels[1] <= bottom) and box == camera.bounds:
        raise InputError(f"{name}: the workspace lies outside the photo (its centre projects to {pixels})")
