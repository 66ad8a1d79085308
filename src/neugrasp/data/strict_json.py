"""JSON from a stranger: one reading for all, or an error that names the file."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from neugrasp.data.user_files import as_text, read_bytes
from neugrasp.errors import InputError

LARGEST = 64 * 2**20
"""Bytes that a file may have: cameras of ten thousand photos take a tenth of that."""
DEEPEST = 50
"""Lists and objects that may lie in each other; a matrix in a list of views is four deep."""
LONGEST = 30
"""Digits that a whole number may have; a longer one is no length, no count and no identifier."""
HALVES = re.compile("[\ud800-\udfff]")
"""Halves of characters, which no text holds."""
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f]")
"""Control characters, which move a terminal, and which no name and no word needs."""


def read_json(path: Path, what: str, judges_values: bool = True) -> Any:
    """The content of a JSON file; `what` says what it should be, for the messages.

    Raises `InputError` naming the file where it is missing, no regular file, larger than 64 MiB, no JSON in
    UTF-8, or where it means different things to different readers: a name given twice, halves of characters,
    numbers of many digits, lists in lists more than 50 deep. NaN, infinite numbers and control characters are
    refused, too, unless whoever reads the fields `judges_values` itself and can name the field: then False.
    """
    try:
        data = read_bytes(path, LARGEST)
    except FileNotFoundError:
        raise InputError(f"{path}: missing; {what} is needed") from None
    return parse_json(data, f"{path}", judges_values)


def read_object(path: Path, what: str, judges_values: bool = False) -> dict[str, Any]:
    """The same of a file whose content is an object; raises `InputError` where it is something else.

    By default for captures: who reads their fields says which number of which view is wrong.
    """
    content = read_json(path, what, judges_values)
    if not isinstance(content, dict):
        raise InputError(f"{path}: not {what}; it must be an object in braces")
    return content


def parse_json(data: bytes | str, source: str, judges_values: bool = True) -> Any:
    """`read_json` of text in memory; `source` is what the messages name."""
    text = data if isinstance(data, str) else as_text(data, source)
    number = _finite if judges_values else float
    try:
        content = json.loads(
            text,
            object_pairs_hook=_object,
            parse_int=_whole,
            parse_float=number,
            parse_constant=number,
        )
        _check_words(content, judges_values)
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
        raise ValueError(f"the key {doubled[:80]!a} is given twice in one object; which one is meant?")
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


def _check_words(content: Any, judges_values: bool) -> None:
    """Raises `ValueError` on what no word holds, and where lists and objects lie too deep in each other."""
    level = [content]
    for _ in range(DEEPEST):
        inside: list[Any] = []
        for value in level:
            if isinstance(value, dict):
                inside += [*value, *value.values()]
            elif isinstance(value, list):
                inside += value
            elif isinstance(value, str) and HALVES.search(value):
                raise ValueError(f"{value[:80]!a} holds half a character")
            elif isinstance(value, str) and judges_values and CONTROL.search(value):
                raise ValueError(f"{value[:80]!a} holds a control character")
        if not inside:
            return
        level = inside
    raise ValueError(f"lists and objects lie more than {DEEPEST} deep in each other")
