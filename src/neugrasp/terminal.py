"""What the program says, as a terminal can show it."""

from __future__ import annotations

import difflib
import io
import logging
import sys
import unicodedata
from collections.abc import Collection, Sequence
from typing import TextIO

from neugrasp.errors import InputError


def speak_plainly() -> None:
    """What a stream cannot say in its own encoding is spelt out, and what is logged goes to stderr."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    logging.basicConfig(level=logging.INFO, handlers=[terminal_log(sys.stderr)])


def check_command(words: Sequence[str], commands: Collection[str]) -> None:
    """Raises `InputError` with the nearest command where the first word is none."""
    if words[0] in commands:
        return
    near = difflib.get_close_matches(words[0], commands, n=1)
    hint = f"did you mean {near[0]}?" if near else f"choose one of {', '.join(commands)}"
    raise InputError(f"there is no command {words[0]!r}; {hint}")


def printable(text: object, stream: TextIO | None = None) -> str:
    """The text as a terminal may get it: words from a file cannot move the cursor, colour or clear anything.

    Control characters, marks that turn the direction of writing, halves of characters, and what the encoding
    of `stream` (sys.stdout by default) lacks are written as escapes; new lines and tabs stay.
    """
    shown = "".join(map(_visible, str(text)))
    encoding = getattr(stream or sys.stdout, "encoding", None) or "utf-8"
    return shown.encode(encoding, "backslashreplace").decode(encoding)


def _visible(character: str) -> str:
    is_harmless = character in "\n\t" or unicodedata.category(character) not in ("Cc", "Cf", "Cs", "Zl", "Zp")
    return character if is_harmless else character.encode("unicode_escape", "surrogatepass").decode("ascii")


class _Printable(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record), sys.stderr)


class _Once(logging.Filter):
    """A warning is told once, however often a file is read."""

    def __init__(self) -> None:
        super().__init__()
        self._told: set[str] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        text = record.getMessage()
        if record.levelno != logging.WARNING:
            return True
        is_new = text not in self._told
        self._told.add(text)
        return is_new


def terminal_log(stream: TextIO) -> logging.Handler:
    """Messages alone, one a line, as a terminal may get them; the same warning only once."""
    handler = logging.StreamHandler(stream)
    handler.addFilter(_Once())
    handler.setFormatter(_Printable("%(message)s"))
    return handler
