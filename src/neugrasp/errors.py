"""What can go wrong in a user's hands, each with what would be right."""

from __future__ import annotations

import importlib
import logging
import sys
import unicodedata
from types import ModuleType
from typing import TextIO


class NeuGraspError(Exception):
    """An error that a user can cause and mend. Programs exit with code 2 and print its text."""


class InputError(NeuGraspError, ValueError):
    """A file or a value given by the user cannot be used."""


class MissingExtra(NeuGraspError, ImportError):
    """An optional dependency is needed and absent."""

    def __init__(self, module: str, extra: str):
        super().__init__(f"{module!r} is not installed. Run: pip install 'neugrasp[{extra}]'")


class BrokenExtra(NeuGraspError, ImportError):
    """An optional dependency is installed and cannot be loaded, most often for want of a system library."""

    def __init__(self, module: str, error: ImportError):
        super().__init__(
            f"{module!r} is installed but cannot be loaded: {error}. If a lib*.so is missing, install the "
            "system package that holds it (Blender on Debian or Ubuntu: apt install libx11-6 libxi6 "
            "libxfixes3 libxrender1 libxkbcommon0 libsm6 libgl1)"
        )


def require(module: str, extra: str) -> ModuleType:
    """The named module; raises `MissingExtra` with the install command where it is absent, and `BrokenExtra`
    where it is there and does not load."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name == module:
            raise MissingExtra(module, extra) from error
        raise BrokenExtra(module, error) from error
    except ImportError as error:
        raise BrokenExtra(module, error) from error


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
