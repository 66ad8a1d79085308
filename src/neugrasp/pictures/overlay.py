"""Grasps drawn into a photo as wireframes of the gripper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, apply, inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.observation import Image, View

NEAR = 0.01
"""Metres; what is nearer to the camera is not drawn."""
OVERSAMPLING = 2
BEST, MIDDLE, WORST = np.array([60, 220, 90]), np.array([250, 200, 40]), np.array([235, 70, 50])


def photo_of_workspace(view: View, workspace: Workspace, size: int = 512) -> View:
    """The measured part of the view's photo that shows the workspace, its longer side `size` pixels."""
    camera = view.camera.moved(inverse(workspace.world_from_workspace))
    wanted, measured = np.array(workspace.photo_box(camera)), np.array(camera.bounds)
    left, top = np.maximum(wanted, measured)[:2].tolist()
    right, bottom = np.minimum(wanted, measured)[2:].tolist()
    scale = size / max(right - left, bottom - top)
    width, height = (max(1, round(side * scale)) for side in (right - left, bottom - top))

    def cut(image: Image) -> Image:
        # PIL counts from the left edge of the first pixel.
        corners = (left + 0.5, top + 0.5, right + 0.5, bottom + 0.5)
        picture = Picture.fromarray(image).transform(
            (width, height), Picture.Transform.EXTENT, corners, Picture.Resampling.BICUBIC
        )
        return np.asarray(picture)

    camera = view.camera.cropped_and_resized((left, top, right, bottom), width, height)
    return View(camera, cut(view.image), cut(view.background), name=view.name)


def draw_grasps(view: View, grasps: Sequence[Grasp], gripper: Gripper, smallest: int = 512) -> Image:
    """The photo with a wireframe of the gripper at every grasp (world frame, best first), the best on top.

    Colour goes by rank, green for the best. A photo less than `smallest` pixels wide or high is enlarged.
    """
    camera = view.camera
    scale = max(1.0, smallest / min(camera.width, camera.height))
    width, height = round(camera.width * scale), round(camera.height * scale)
    photo = Picture.fromarray(view.image).resize((width, height), Picture.Resampling.BICUBIC)
    box = (-0.5, -0.5, camera.width - 0.5, camera.height - 0.5)
    large = camera.cropped_and_resized(box, width * OVERSAMPLING, height * OVERSAMPLING)
    layer = Picture.new("RGBA", (large.width, large.height), (0, 0, 0, 0))
    pen = ImageDraw.Draw(layer)
    thickness = max(2, round(0.006 * min(large.width, large.height)))
    for rank in reversed(range(len(grasps))):
        segments = _pixel_segments(grasps[rank], gripper, large)
        colour = _colour(rank, len(grasps))
        extra = 1.5 if rank == 0 else 1.0
        for thick, ink in ((2.0, (15, 15, 15, 200)), (1.0, (*colour, 255))):
            for segment in segments:
                _line(pen, segment, thickness * extra * thick, ink)
    layer = layer.resize((width, height), Picture.Resampling.BOX)
    photo.paste(layer, mask=layer.getchannel("A"))
    return np.asarray(photo)


def _colour(rank: int, count: int) -> tuple[int, int, int]:
    """From green for the first to red for the last."""
    place = rank / max(count - 1, 1)
    first, second, share = (BEST, MIDDLE, 2 * place) if place < 0.5 else (MIDDLE, WORST, 2 * place - 1)
    red, green, blue = (first + (second - first) * share).round().astype(int).tolist()
    return red, green, blue


def _pixel_segments(grasp: Grasp, gripper: Gripper, camera: Camera) -> Array:
    """The wireframe as segments (k, 2, 2) in pixels; what lies behind the camera is cut off."""
    camera_from_grasp = inverse(camera.world_from_camera) @ grasp.pose
    segments = apply(camera_from_grasp, gripper.wireframe(grasp.width))
    clipped = [_clipped(*segment) for segment in segments]
    visible = [segment for segment in clipped if segment is not None]
    if not visible:
        return np.zeros((0, 2, 2))
    pixels, _ = camera.project(apply(camera.world_from_camera, np.stack(visible)))
    return pixels


def _clipped(start: Array, end: Array) -> Array | None:
    """The part of a segment in front of the near plane, camera frame."""
    if start[2] < NEAR and end[2] < NEAR:
        return None
    if start[2] < NEAR or end[2] < NEAR:
        crossing = start + (NEAR - start[2]) / (end[2] - start[2]) * (end - start)
        start, end = (crossing, end) if start[2] < NEAR else (start, crossing)
    return np.stack([start, end])


def _line(pen: ImageDraw.ImageDraw, segment: Array, thickness: float, ink: tuple[int, int, int, int]) -> None:
    """A thick line with round ends."""
    limit = 1e5  # Far beyond any picture, and well inside what PIL can draw.
    if np.abs(segment).max() > limit:
        return
    # Pixel centres lie at integers here and at halves in PIL.
    (u0, v0), (u1, v1) = (segment + 0.5).tolist()
    pen.line((u0, v0, u1, v1), fill=ink, width=round(thickness))
    r = thickness / 2
    for u, v in ((u0, v0), (u1, v1)):
        pen.ellipse((u - r, v - r, u + r, v + r), fill=ink)
