"""Files that users hand in, read whole: regular files only, with errors that name the file."""

from __future__ import annotations

import stat
import unicodedata
from pathlib import Path

from neugrasp.errors import InputError

LARGEST_TEXT = 64 * 2**20
"""Bytes that a text may have."""


def read_bytes(file: Path, largest: int | None = None) -> bytes:
    """The content of a regular file: a pipe or a device might never end.

    Raises `InputError` where it cannot be read, and `FileNotFoundError` where it is not there.
    """
    check_regular(file)
    try:
        if largest is not None and (size := file.stat().st_size) > largest:
            raise InputError(f"{file}: {size / 2**20:.0f} MiB; at most {largest / 2**20:.0f} are read")
        return file.read_bytes()
    except FileNotFoundError:
        raise
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror})") from error


def check_regular(file: Path) -> None:
    """Raises `InputError` where `file` is no regular file, `FileNotFoundError` where there is none."""
    try:
        mode = file.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(f"{file}: missing") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    if not stat.S_ISREG(mode):
        what = "a folder" if stat.S_ISDIR(mode) else "a pipe, a socket or a device"
        raise InputError(f"{file}: is {what}; only regular files are read")


def read_text(file: Path) -> str:
    """A text in UTF-8, without the mark of byte order of Windows in front. Raises like `read_bytes`."""
    return as_text(read_bytes(file, LARGEST_TEXT), f"{file}")


def as_text(data: bytes, source: str) -> str:
    """The text that bytes are in UTF-8, with or without a mark of byte order. Raises `InputError` naming the
    `source`."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{source}: no text in UTF-8 ({error}); save it as UTF-8") from error


def check_name(name: str, where: str) -> None:
    """Raises `InputError` where a name holds control characters, which no camera writes."""
    if any(unicodedata.category(letter) in ("Cc", "Zl", "Zp") for letter in name):
        raise InputError(f"{where}: the name {name!a} holds control characters; rename the file")
