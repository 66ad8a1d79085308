"""What is read of a photo: 8 bits a channel, of a size that is stated, as the pixels are stored."""

from __future__ import annotations

import io
import logging
import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture
from PIL.PngImagePlugin import PngInfo

from neugrasp.data.photo_files import image_size, photo_tags, read_image
from neugrasp.errors import InputError

PHOTO = np.arange(48 * 40 * 3, dtype=np.uint32).reshape(40, 48, 3).astype(np.uint8)


def png(file: Path, width: int, height: int, bits: int, kind: int, rows: bytes) -> Path:
    """A PNG written by hand; `kind` 0 is grey, 2 colour, 6 colour and alpha."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0))
    body = chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + head + body)
    return file


def deep(values: np.ndarray, file: Path) -> Path:
    """A PNG as cameras with deep pixels write it: (h, w, channels) of 16 bits."""
    height, width, channels = values.shape
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in values)
    return png(file, width, height, 16, {1: 0, 3: 2, 4: 6}[channels], rows)


def bomb(file: Path, width: int, height: int) -> Path:
    """A PNG of a few bytes that says it is of that size."""
    return png(file, width, height, 1, 0, bytes(1000))


SIZES = [(13000, 13000), (10001, 10000), (30000, 30000), (100_000_001, 1), (200_000, 200_000)]


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_too_many_pixels_are_refused_before_they_are_decoded(tmp_path: Path, width: int, height: int):
    file = bomb(tmp_path / "a.png", width, height)
    for read in (read_image, image_size, photo_tags):
        with pytest.raises(
            InputError, match=r"more than the 100 megapixels that are read; view 0 needs a sm"
        ):
            read(file, "view 0")


def test_a_size_within_the_limit_is_told_without_a_warning(tmp_path: Path):
    assert image_size(bomb(tmp_path / "a.png", 10000, 9999), "view 0") == (10000, 9999)


@pytest.mark.parametrize("channels", [3, 4])
def test_sixteen_bits_are_read_as_their_upper_eight_and_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, channels: int
):
    values = np.full((40, 48, channels), 65535, dtype=np.uint16)
    values[..., :3] = PHOTO.astype(np.uint16) * 257
    file = deep(values, tmp_path / "deep.png")
    with caplog.at_level(logging.WARNING):
        np.testing.assert_array_equal(read_image(file, "view 0"), PHOTO)
    assert "deep.png: 16 bits a channel" in caplog.text


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_a_sensors_bits_in_the_lower_half_are_no_photo(tmp_path: Path, bits: int):
    file = deep(PHOTO.astype(np.uint16) << (bits - 8), tmp_path / "raw.png")
    with pytest.raises(InputError, match=r"raw\.png: 16 bits a channel of which the upper ones are empty"):
        read_image(file, "view 0")


def test_deep_grey_and_inks_are_refused(tmp_path: Path):
    file = deep(PHOTO[..., :1].astype(np.uint16) * 257, tmp_path / "depth.png")
    with pytest.raises(InputError, match="pixels of type I;16; view 0 needs an 8-bit RGB photo"):
        read_image(file, "view 0")
    Picture.fromarray(PHOTO).convert("CMYK").save(tmp_path / "print.jpg")
    with pytest.raises(InputError, match="pixels of type CMYK"):
        read_image(tmp_path / "print.jpg", "view 0")


@pytest.mark.parametrize("value", range(1, 9))
def test_an_orientation_is_told_and_turns_nothing(tmp_path: Path, value: int):
    tags = Picture.Exif()
    tags[274] = value
    Picture.fromarray(PHOTO).save(tmp_path / "a.png", exif=tags)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png", "view 0"), PHOTO)
    lies = photo_tags(tmp_path / "a.png", "view 0").lies
    assert (lies is None) == (value == 1)
    assert ("90" in (lies or "")) == (value >= 5)


def test_holes_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    alpha = np.full((40, 48, 1), 255, dtype=np.uint8)
    Picture.fromarray(np.concatenate([PHOTO, alpha], axis=-1)).save(tmp_path / "whole.png")
    with caplog.at_level(logging.WARNING):
        np.testing.assert_array_equal(read_image(tmp_path / "whole.png", "view 0"), PHOTO)
        assert not caplog.text
        alpha[:10] = 0
        Picture.fromarray(np.concatenate([PHOTO, alpha], axis=-1)).save(tmp_path / "cut.png")
        np.testing.assert_array_equal(read_image(tmp_path / "cut.png", "view 0"), PHOTO)
    assert "cut.png: 25 % of it are transparent" in caplog.text


@pytest.mark.timeout(20)
def test_what_is_no_photo_is_named(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "phone.heic").write_bytes(b"\0\0\0\x18ftypheic" + bytes(100))
    (tmp_path / "drawing.png").write_text("%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 99 99\n")
    for name, message in (
        ("pipe.png", "is a pipe, a socket or a device; only regular files"),
        ("text.png", "no image that can be read; view 0 needs"),
        ("phone.heic", "a HEIC picture, or no picture at all; view 0 needs a complete PNG or JPEG"),
        ("drawing.png", "no image that can be read"),
        ("none.png", "missing; view 0 names it"),
    ):
        for read in (read_image, image_size, photo_tags):
            with pytest.raises(InputError, match=message):
                read(tmp_path / name, "view 0")


@pytest.mark.slow
def test_damaged_tags_are_no_tags(tmp_path: Path):
    """Not a word of Pillow's, whatever the bytes of the tags are."""
    tags = Picture.Exif()
    tags[274], tags[0x8769] = 6, {0xA405: 26, 0xA002: 64, 0xA003: 48, 0x920A: 4.2}
    stream, file = io.BytesIO(), tmp_path / "a.jpg"
    Picture.new("RGB", (64, 48)).save(stream, "JPEG", exif=tags)
    right, rng = stream.getvalue(), np.random.default_rng(0)
    begin = right.index(b"Exif")
    for _ in range(400):
        data = np.frombuffer(right, np.uint8).copy()
        places = begin + rng.integers(0, 160, rng.integers(1, 6))
        data[places] = rng.integers(0, 256, len(places))
        file.write_bytes(data.tobytes())
        try:
            found = photo_tags(file, "view 0")
        except InputError:
            continue
        assert found.focal_35mm is None or 5 <= found.focal_35mm <= 2000
        assert found.lies is None or len(found.lies) < 50


XMP = (
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    b'<rdf:Description xmlns:tiff="http://ns.adobe.com/tiff/1.0/" tiff:Orientation="6"/></rdf:RDF>'
    b"</x:xmpmeta>"
)


@pytest.mark.parametrize("place", ["MPO", "XMP", "text of a PNG"])
def test_an_orientation_is_found_wherever_it_is_written(tmp_path: Path, place: str):
    tags = Picture.Exif()
    tags[274] = 6
    picture, file = Picture.fromarray(PHOTO), tmp_path / "a.jpg"
    if place == "MPO":
        picture.save(file, "MPO", exif=tags)
    elif place == "XMP":
        picture.save(file, xmp=XMP)
    else:
        text = PngInfo()
        text.add_text("Raw profile type exif", f"\nexif\n{len(tags.tobytes()):8}\n{tags.tobytes().hex()}")
        picture.save(file, "PNG", pnginfo=text)
    assert photo_tags(file, "view 0").lies == "turned by 90 degrees"
    assert read_image(file, "view 0").shape == PHOTO.shape


@pytest.mark.parametrize("mode", ["LA", "P", "L", "1", "RGBA"])
def test_photos_of_few_colours_are_read_as_they_look(tmp_path: Path, mode: str):
    picture = Picture.fromarray(PHOTO).convert(mode)
    picture.save(tmp_path / "a.png")
    np.testing.assert_array_equal(
        read_image(tmp_path / "a.png", "view 0"), np.asarray(picture.convert("RGB"))
    )


@pytest.mark.parametrize("mode", ["P", "L"])
def test_a_colour_that_is_transparent_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture, mode: str):
    picture = Picture.fromarray(PHOTO).convert(mode)
    picture.save(tmp_path / "a.png", transparency=int(np.asarray(picture)[0, 0]))
    read_image(tmp_path / "a.png", "view 0")
    assert "are transparent" in caplog.text


@pytest.mark.parametrize("mode", ["CMYK", "LAB", "YCbCr", "F", "I"])
def test_other_pixels_are_refused(tmp_path: Path, mode: str):
    grey = Picture.fromarray(PHOTO[..., 0].astype(np.float32 if mode == "F" else np.int32))
    (grey if mode in "FI" else Picture.fromarray(PHOTO).convert(mode)).save(tmp_path / "a.tif")
    with pytest.raises(InputError, match=f"pixels of type {mode}; view 0 needs an 8-bit RGB photo"):
        read_image(tmp_path / "a.tif", "view 0")


@pytest.mark.parametrize("kind", ["png", "jpg"])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5])
def test_a_file_that_was_cut_off_is_refused(tmp_path: Path, kind: str, share: float):
    file = tmp_path / f"a.{kind}"
    Picture.fromarray(PHOTO).save(file)
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    with pytest.raises(InputError, match="needs a complete PNG or JPEG photo"):
        read_image(file, "view 0")
