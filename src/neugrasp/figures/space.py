"""Lines, faces and photos in space, drawn over a picture as a camera sees them, without hiding each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array
from neugrasp.observation import Image

OVERSAMPLING = 2
NEAR = 0.01
"""Metres; what is nearer to the camera is not drawn."""
Colour = tuple[int, int, int]


class Canvas:
    """A picture that is drawn upon, back to front. Points and `camera` share one frame."""

    def __init__(self, ground: Image, camera: Camera):
        """`ground` is `OVERSAMPLING` times as wide and high as the finished picture."""
        height, width = ground.shape[:2]
        whole = (-0.5, -0.5, camera.width - 0.5, camera.height - 0.5)
        self.camera = camera.cropped_and_resized(whole, width, height)
        self._picture = Picture.fromarray(ground).convert("RGBA")

    def line(self, points: ArrayLike, colour: Colour, width: float, opacity: float = 1.0) -> None:
        """A line through points (n, 3), `width` pixels of the finished picture wide."""
        pixels, depth = self.camera.project(np.asarray(points, dtype=np.float64))
        layer, pen = self._layer()
        thick = width * OVERSAMPLING
        for i in range(len(pixels) - 1):
            if depth[i : i + 2].min() > NEAR:
                pen.line(_flat(pixels[i : i + 2]), fill=_ink(colour, opacity), width=round(thick))
        for (u, v), z in zip(pixels + 0.5, depth, strict=True):
            if z > NEAR and thick > 3:
                r = thick / 2 - 0.5
                pen.ellipse((u - r, v - r, u + r, v + r), fill=_ink(colour, opacity))
        self._picture.alpha_composite(layer)

    def face(self, corners: ArrayLike, colour: Colour, opacity: float) -> None:
        """A filled polygon (n, 3)."""
        pixels, depth = self.camera.project(np.asarray(corners, dtype=np.float64))
        if depth.min() > NEAR:
            layer, pen = self._layer()
            pen.polygon(_flat(pixels), fill=_ink(colour, opacity))
            self._picture.alpha_composite(layer)

    def photo(self, image: Image, corners: ArrayLike) -> None:
        """A photo on a rectangle (4, 3): upper left, upper right, lower right, lower left."""
        pixels, depth = self.camera.project(np.asarray(corners, dtype=np.float64))
        if depth.min() <= NEAR:
            return
        height, width = image.shape[:2]
        inside = np.array([(0, 0), (width, 0), (width, height), (0, height)], dtype=np.float64)
        warped = Picture.fromarray(image).transform(
            self._picture.size,
            Picture.Transform.PERSPECTIVE,
            homography(pixels + 0.5, inside).reshape(-1)[:8].tolist(),
            Picture.Resampling.BICUBIC,
        )
        mask = Picture.new("L", self._picture.size, 0)
        ImageDraw.Draw(mask).polygon(_flat(pixels), fill=255)
        self._picture.paste(warped, mask=mask)

    def words(self, text: str, place: ArrayLike, colour: Colour, size: float) -> None:
        """Text centred on a point (3,), `size` pixels of the finished picture high."""
        pixels, _ = self.camera.project(np.asarray(place, dtype=np.float64))
        font = ImageFont.load_default(size * OVERSAMPLING)
        u, v = (pixels + 0.5).tolist()
        pen = ImageDraw.Draw(self._picture)
        pen.text((u, v), text, fill=colour, font=font, anchor="mm", stroke_width=5, stroke_fill="white")

    def image(self) -> Image:
        """The finished picture."""
        width, height = (side // OVERSAMPLING for side in self._picture.size)
        return np.asarray(self._picture.convert("RGB").resize((width, height), Picture.Resampling.BOX))

    def _layer(self) -> tuple[Picture.Image, ImageDraw.ImageDraw]:
        layer = Picture.new("RGBA", self._picture.size, (0, 0, 0, 0))
        return layer, ImageDraw.Draw(layer)


def homography(sources: Array, targets: Array) -> Array:
    """The map (3, 3), its last entry 1, that takes four points (4, 2) of a plane to four others."""
    rows, values = [], []
    for (x, y), (u, v) in zip(sources, targets, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        values += [u, v]
    entries = np.linalg.solve(np.array(rows), np.array(values))
    return np.append(entries, 1.0).reshape(3, 3)


def _ink(colour: Colour, opacity: float) -> tuple[int, int, int, int]:
    return (*colour, round(255 * opacity))


def _flat(pixels: Array) -> list[tuple[float, float]]:
    # Pixel centres lie at integers here and at halves in PIL.
    return [(u, v) for u, v in (pixels + 0.5).tolist()]
