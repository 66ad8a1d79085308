"""Grasps drawn into a photo as wireframes of the gripper, each with its number."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, apply, inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.observation import Image, View
from neugrasp.pictures.score_scale import Colour, colour_of_score

NEAR = 0.01
"""Metres; what is nearer to the camera is not drawn."""
OVERSAMPLING = 2
OUTLINE = (15, 15, 15, 200)
FARTHEST = 1e5
"""Pixels: far beyond any picture, and well inside what PIL can draw."""
NUMBER_SIZE = 0.03
"""Height of the digits, in sides of the photo."""


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


def draw_grasps(
    view: View,
    grasps: Sequence[Grasp],
    gripper: Gripper,
    smallest: int = 512,
    colours: Sequence[Colour] | None = None,
) -> Image:
    """The photo with a wireframe of the gripper at every grasp (world frame, best first), the best on top.

    Colour goes by score, the same in every picture (`colour_of_score`), unless `colours` are given. Several
    grasps are numbered from 1, as everywhere. A photo less than `smallest` pixels wide or high is enlarged.
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
    colours = [colour_of_score(grasp.score) for grasp in grasps] if colours is None else colours
    for rank in reversed(range(len(grasps))):
        segments = _pixel_segments(grasps[rank], gripper, large)
        extra = 1.5 if rank == 0 else 1.0
        for thick, ink in ((2.0, OUTLINE), (1.0, (*colours[rank], 255))):
            for segment in segments:
                _line(pen, segment, thickness * extra * thick, ink)
        if len(grasps) > 1 and len(segments):
            _number(pen, rank + 1, segments[-1], colours[rank], (large.width, large.height))
    layer = layer.resize((width, height), Picture.Resampling.BOX)
    photo.paste(layer, mask=layer.getchannel("A"))
    return np.asarray(photo)


def _number(pen: ImageDraw.ImageDraw, number: int, arm: Array, colour: Colour, size: tuple[int, int]) -> None:
    """The number of a grasp on a disc of its colour, at the far end of its arm, a segment (2, 2) in pixels;
    at the border where that lies outside a picture of `size` that shows the near end."""
    radius = NUMBER_SIZE * min(size)
    low, high = np.full(2, radius), np.array(size) - 1 - radius
    place = arm[0].clip(low, high) if np.all((arm[1] >= 0) & (arm[1] < size)) else arm[0]
    if np.abs(place).max() > FARTHEST:
        return
    u, v = (place + 0.5).tolist()
    disc = (u - radius, v - radius, u + radius, v + radius)
    pen.ellipse(disc, fill=(*colour, 255), outline=OUTLINE, width=4)
    pen.text((u, v), str(number), (0, 0, 0, 255), ImageFont.load_default(1.5 * radius), anchor="mm")


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
    if np.abs(segment).max() > FARTHEST:
        return
    # Pixel centres lie at integers here and at halves in PIL.
    (u0, v0), (u1, v1) = (segment + 0.5).tolist()
    pen.line((u0, v0, u1, v1), fill=ink, width=round(thickness))
    r = thickness / 2
    for u, v in ((u0, v0), (u1, v1)):
        pen.ellipse((u - r, v - r, u + r, v + r), fill=ink)
