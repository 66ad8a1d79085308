"""Photos on disk: what is read of them, and what is not."""

from __future__ import annotations

import io
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
from PIL import Image as Picture
from PIL import UnidentifiedImageError
from PIL.PngImagePlugin import PngImageFile

from neugrasp.data.user_files import check_regular
from neugrasp.errors import InputError
from neugrasp.observation import Image

SMALLEST_IMAGE = 32
"""Pixels; a smaller photo is a thumbnail or a mistake."""
MOST_PIXELS = 100_000_000
"""Most pixels of a photo, asked before it is decoded: a small file can hold a picture that fills the
memory."""
FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TIFF")
"""As Pillow calls them; no other reader of its many is given a user's file."""
FOREIGN = {
    ".heic": "HEIC",
    ".heif": "HEIF",
    ".avif": "AVIF",
    ".tif": "TIFF",
    ".tiff": "TIFF",
    ".webp": "WebP",
    ".bmp": "BMP",
    ".gif": "GIF",
    ".jp2": "JPEG 2000",
    ".jxl": "JPEG XL",
    ".exr": "OpenEXR",
    ".ppm": "PPM",
    ".pgm": "PGM",
    **dict.fromkeys((".dng", ".raw", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".rw2", ".raf"), "raw"),
}
"""Suffixes of pictures that importers do not look for, with their names."""
DARKEST_WHITE = 64
"""Out of 255: what the brightest pixel of a photo in 16 bits must reach."""
ORIENTATION_TAG = 274
DETAILS, FOCAL_35MM_TAG, SIZE_TAGS = 0x8769, 0xA405, (0xA002, 0xA003)
"""EXIF: the directory of what a camera says of a photo; in it the focal length, and width and height."""
FOCAL_35MM = 5, 2000
"""Millimetres of lenses that there are; cameras that do not know theirs write 0."""
PNG_START, PNG_CHECKSUM = 8, 4
"""Bytes before the first chunk of a PNG, and behind each."""
PNG_TAGS = frozenset((b"eXIf", b"tEXt", b"zTXt", b"iTXt"))
"""Chunks of a PNG in which tags may stand."""
OTHER_FOCAL = 1.25
"""Factor by which fx may differ from what a photo says: makers round, and stabilised photos are cropped."""
AS_STORED = {
    2: "mirrored",
    3: "turned by 180 degrees",
    4: "mirrored, upside down",
    5: "mirrored and turned by 90 degrees",
    6: "turned by 90 degrees",
    7: "mirrored and turned by 90 degrees",
    8: "turned by 90 degrees",
}
"""How the pixels lie in the file, by the EXIF orientation that would set it right."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Photo:
    """A photo that came by another way than a file: as a file holds it, and what messages call it."""

    name: str
    data: bytes = field(repr=False)

    def __str__(self) -> str:
        return self.name

    @property
    def suffix(self) -> str:
        """As that of a path."""
        return Path(self.name).suffix


def read_image(file: Path | Photo, where: str) -> Image:
    """A photo as RGB, (height, width, 3), its pixels as they are stored: an EXIF orientation turns nothing.
    `where` says who asked for it, for the message."""
    with _opened(file, where) as picture:
        # The decoder's argument, or the first of them, names the layout in the file, such as RGB;16B.
        is_deep = any(";16" in str(part[3]) for part in getattr(picture, "tile", ()))
        if picture.mode not in ("RGB", "RGBA", "L", "LA", "P", "1"):
            raise InputError(f"{file}: pixels of type {picture.mode}; {where} needs an 8-bit RGB photo")
        _tell_of_holes(picture, file)
        image: Image = np.asarray(picture.convert("RGB"), dtype=np.uint8)
        if is_deep:
            _check_depth(image, file, where)
    if min(image.shape[:2]) < SMALLEST_IMAGE:
        raise InputError(
            f"{file}: {image.shape[1]} x {image.shape[0]} pixels; {where} needs a photo of at least "
            f"{SMALLEST_IMAGE} x {SMALLEST_IMAGE}"
        )
    return image


def image_size(file: Path | Photo, where: str) -> tuple[int, int]:
    """Width and height of a photo, which is not decoded. Raises like `read_image`."""
    with _opened(file, where) as picture:
        return picture.size


@dataclass(frozen=True)
class Tags:
    """What a photo says of itself in EXIF."""

    lies: str | None = None
    """How the pixels lie that want to be shown another way; None where they are upright. Programs differ:
    OpenCV turns such a photo when it reads it, this one does not."""
    focal_35mm: float | None = None
    """Focal length that shows as much on 35 mm film, millimetres; None where it is not known."""
    focal_pixels: float | None = None
    """The same in pixels of the photo; None where it is not known, or the photo was cropped."""


def photo_tags(file: Path | Photo, where: str) -> Tags:
    """The tags of a photo, which is not decoded. Raises like `read_image`."""
    with _opened(file, where) as picture:
        exif = _exif(picture)
        value, details, size = exif.get(ORIENTATION_TAG, 1), exif.get_ifd(DETAILS), picture.size
    lies = None if value in (0, 1) else AS_STORED.get(value, f"tagged {str(value)[:20]!r}")
    focal = details.get(FOCAL_35MM_TAG)
    if not isinstance(focal, int | float) or not FOCAL_35MM[0] <= focal <= FOCAL_35MM[1]:
        return Tags(lies)
    # By the diagonal, as the standard has it, of a frame of 36 x 24 mm.
    pixels = None if _is_cropped(details, size) else float(focal * np.hypot(*size) / np.hypot(36, 24))
    return Tags(lies, float(focal), pixels)


def _exif(picture: Picture.Image) -> Picture.Exif:
    """The tags. Pillow decodes a PNG to see whether some stand behind its pixels; chunks say it, too."""
    if isinstance(picture, PngImageFile) and not _has_late_tags(picture.fp):
        return Picture.Image.getexif(picture)
    return picture.getexif()


def _has_late_tags(file: IO[bytes] | None) -> bool:
    """Whether a PNG has tags behind its first pixels; the place in the file stays as it is."""
    assert file is not None
    place, kinds = file.tell(), list[bytes]()
    file.seek(PNG_START)
    while len(head := file.read(8)) == 8:
        kinds.append(head[4:])
        file.seek(int.from_bytes(head[:4], "big") + PNG_CHECKSUM, io.SEEK_CUR)
    file.seek(place)
    late = kinds[kinds.index(b"IDAT") :] if b"IDAT" in kinds else kinds
    return not PNG_TAGS.isdisjoint(late)


def _is_cropped(details: dict[int, Any], size: tuple[int, int]) -> bool:
    """Whether a photo has other proportions than the camera wrote down, however it was turned since."""
    first = [details.get(tag) for tag in SIZE_TAGS]
    if not all(isinstance(side, int) and side > 0 for side in first):
        return False
    (narrow, wide), (narrow_now, wide_now) = sorted(map(int, first)), sorted(size)  # type: ignore[arg-type]
    return abs(wide_now * narrow / (narrow_now * wide) - 1) > 0.02


@contextmanager
def _opened(file: Path | Photo, where: str) -> Iterator[Picture.Image]:
    """The picture, not decoded yet; what goes wrong until it is closed becomes an `InputError`."""
    try:
        source: Path | io.BytesIO = io.BytesIO(file.data) if isinstance(file, Photo) else file
        if isinstance(source, Path):
            check_regular(source)
        with warnings.catch_warnings():
            # Pillow warns from 89 megapixels on; the limit here is our own. Damaged tags are no tags to us.
            warnings.simplefilter("ignore", Picture.DecompressionBombWarning)
            warnings.simplefilter("ignore", UserWarning)
            with Picture.open(source, formats=FORMATS) as picture:
                _check_size(picture, file, where)
                yield picture
    except FileNotFoundError:
        raise InputError(f"{file}: missing; {where} names it") from None
    except InputError:
        raise
    except Picture.DecompressionBombError:
        raise InputError(_too_large(file, "far more", where)) from None
    except UnidentifiedImageError:
        name = FOREIGN.get(file.suffix.lower())
        what = f"a {name} picture, or no picture at all" if name else "no image that can be read"
        raise InputError(f"{file}: {what}; {where} needs a complete PNG or JPEG photo") from None
    except (OSError, SyntaxError, ValueError, TypeError, OverflowError, MemoryError) as error:
        raise InputError(f"{file}: {error}; {where} needs a complete PNG or JPEG photo") from error


def _check_size(picture: Picture.Image, file: Path | Photo, where: str) -> None:
    width, height = picture.size
    if width * height > MOST_PIXELS:
        raise InputError(_too_large(file, f"{width} x {height} pixels, more", where))


def _too_large(file: Path | Photo, size: str, where: str) -> str:
    return (
        f"{file}: {size} than the {MOST_PIXELS // 10**6} megapixels that are read; {where} needs a smaller "
        "photo"
    )


def _check_depth(image: Image, file: Path | Photo, where: str) -> None:
    """Checks 16 bits a channel, of which the upper 8 are read. Raises `InputError` where they hold no
    photo: sensors with 10 to 14 bits fill the lower ones."""
    if image.max() < DARKEST_WHITE:
        raise InputError(
            f"{file}: 16 bits a channel of which the upper ones are empty (10 to 14 bits of a sensor?); "
            f"{where} needs an 8-bit RGB photo"
        )
    logger.warning("%s: 16 bits a channel; the upper 8 of them are used", file)


def _tell_of_holes(picture: Picture.Image, file: Path | Photo) -> None:
    if "A" in picture.getbands() or "transparency" in picture.info:
        alpha = np.asarray(picture.convert("RGBA").getchannel("A"))
        if (share := float((alpha < 255).mean())) > 0:
            logger.warning(
                "%s: %.0f %% of it are transparent (alpha below 255); the colours underneath are used. "
                "Objects that were cut out cannot be compared with the empty table: give the photo as it was "
                "taken",
                file,
                max(1, 100 * share),
            )
