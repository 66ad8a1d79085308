"""Pictures as files."""

from __future__ import annotations

import io
from pathlib import Path

from PIL import Image as Picture

from neugrasp.observation import Image


def write_picture(file: Path, image: Image) -> None:
    """A file of the kind that its name says: PNG, or JPEG for many photos."""
    Picture.fromarray(image).save(file)


def png(image: Image) -> bytes:
    """The picture as the content of a PNG file."""
    stream = io.BytesIO()
    Picture.fromarray(image).save(stream, format="PNG")
    return stream.getvalue()
