"""Files that users hand in, read whole: regular files only, text and JSON with errors that name the file."""

from __future__ import annotations

import json
import stat
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from neugrasp.errors import InputError

LARGEST_TEXT = 64 * 2**20
"""Bytes: cameras of ten thousand photos take a tenth of that as JSON."""
LONGEST_INTEGER = 30
"""Digits; a longer number is no length, no count and no identifier."""
DEEPEST = 32
"""Lists and objects within one another; a matrix in a list of views is four deep."""


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
    try:
        return read_bytes(file, LARGEST_TEXT).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{file}: no text in UTF-8 ({error}); save it as UTF-8") from error


def read_object(file: Path, of: str = "a JSON object") -> dict[str, Any]:
    """The object in a JSON file. Raises `InputError` naming the file.

    What JSON readers differ about is refused: a key given twice, whole numbers of any length, lists within
    lists without end, and halves of characters.
    """
    try:
        text = read_text(file)
    except FileNotFoundError as error:
        raise InputError(str(error)) from None
    try:
        data = json.loads(text, object_pairs_hook=_once, parse_int=_integer)
    except (InputError, json.JSONDecodeError) as error:
        raise InputError(f"{file}: not valid JSON ({error})") from error
    except RecursionError:
        raise InputError(f"{file}: not valid JSON (nested more than {DEEPEST} deep)") from None
    if not isinstance(data, dict):
        raise InputError(f"{file}: not {of}; it must be an object in braces")
    for depth, value in _values(data):
        if depth > DEEPEST:
            raise InputError(f"{file}: not valid JSON (nested more than {DEEPEST} deep)")
        if isinstance(value, str) and any(unicodedata.category(letter) == "Cs" for letter in value):
            raise InputError(f"{file}: not valid JSON ({value!a} holds half a character)")
    return data


def check_name(name: str, where: str) -> None:
    """Raises `InputError` where a name holds control characters, which no camera writes."""
    if any(unicodedata.category(letter) in ("Cc", "Zl", "Zp") for letter in name):
        raise InputError(f"{where}: the name {name!a} holds control characters; rename the file")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    data = dict(pairs)
    if len(data) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"the key {twice!a} is given twice in one object; which one is meant?")
    return data


def _integer(digits: str) -> int:
    if len(digits) > LONGEST_INTEGER:
        raise InputError(f"a number of {len(digits)} digits")
    return int(digits)


def _values(data: Any) -> Iterator[tuple[int, Any]]:
    """Every key and value with how deep it stands, without recursion."""
    left: list[tuple[int, Any]] = [(0, data)]
    while left:
        depth, value = left.pop()
        yield depth, value
        if depth > DEEPEST:
            continue
        inner = [*value.keys(), *value.values()] if isinstance(value, dict) else value
        if isinstance(value, dict | list):
            left += [(depth + 1, part) for part in inner]
