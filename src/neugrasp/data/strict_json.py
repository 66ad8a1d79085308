"""JSON from a stranger: one reading for all, or an error that names the file."""

from __future__ import annotations

import json
import re
import stat
from pathlib import Path
from typing import Any

from neugrasp.errors import InputError

LARGEST = 50_000_000
"""Bytes that a file may have."""
DEEPEST = 50
"""Lists and objects that may lie in each other."""
LONGEST = 30
"""Digits that a whole number may have."""
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")
"""What no name and no word needs: control characters, which move a terminal, and halves of characters."""


def read_json(path: Path, what: str) -> Any:
    """The content of a JSON file; `what` says what it should be, for the messages.

    Raises `InputError` naming the file where it is missing, no file, larger than 50 MB, no JSON in UTF-8, or
    where it means different things to different readers: a name given twice, NaN or an infinite number,
    control characters, lists in lists more than 50 deep.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe or a device"
            raise InputError(f"{path}: is {kind}; {what} is a file")
        if status.st_size > LARGEST:
            raise InputError(f"{path}: {status.st_size / 1e6:.0f} MB; {what} has at most {LARGEST / 1e6:.0f}")
        data = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path}: missing; {what} is needed") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{str(path)!r}: is no name of a file ({error})") from error
    return parse_json(data, f"{path}")


def parse_json(data: bytes | str, source: str) -> Any:
    """The same of text in memory; `source` is what the messages name."""
    try:
        text = data if isinstance(data, str) else data.decode("utf-8-sig")
        content = json.loads(
            text,
            object_pairs_hook=_object,
            parse_int=_whole,
            parse_float=_finite,
            parse_constant=_finite,
        )
        _check_words(content)
    except RecursionError:
        raise InputError(f"{source}: not valid JSON (lists and objects lie too deep in each other)") from None
    except ValueError as error:
        raise InputError(f"{source}: not valid JSON ({error})") from error
    return content


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        doubled = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"{doubled!r} is given twice")
    return content


def _whole(digits: str) -> int:
    if len(digits) > LONGEST:
        raise ValueError(f"a number of {len(digits)} digits")
    return int(digits)


def _finite(word: str) -> float:
    number = float(word)
    if not abs(number) < float("inf"):
        raise ValueError(f"{word[:40]} is not a finite number")
    return number


def _check_words(content: Any) -> None:
    """Raises `ValueError` on control characters, and where lists and objects lie too deep in each other."""
    level = [content]
    for _ in range(DEEPEST):
        inside: list[Any] = []
        for value in level:
            if isinstance(value, dict):
                inside += [*value, *value.values()]
            elif isinstance(value, list):
                inside += value
            elif isinstance(value, str) and CONTROL.search(value):
                raise ValueError(f"{value[:80]!a} holds a control character")
        if not inside:
            return
        level = inside
    raise ValueError(f"lists and objects lie more than {DEEPEST} deep in each other")
